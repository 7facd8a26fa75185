"""What a run leaves on disk: its folder, tables, fields, checkpoints and exports."""

from ngfsi.store.folder import RunFolder
from ngfsi.store.stored import StoredRun, open_run

__all__ = ["RunFolder", "StoredRun", "open_run"]
