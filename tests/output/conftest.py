"""A stored run that several tests read."""

from __future__ import annotations

import pytest

from ngfsi.store.stored import StoredRun
from tests.output.fake import fake_run


@pytest.fixture(scope="session")
def stored(tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    return fake_run(tmp_path_factory.mktemp("stored") / "run")
