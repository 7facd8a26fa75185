"""Child processes: functions that may crash, hang or be killed are called in a Python of their own.

    python -m ngfsi.process [--plugin PLUGIN]... MODULE:FUNCTION ARGUMENT...

calls a function of a module with texts and ends with the number that it returns, 0 for None. What it refuses or fails
at is one sentence, the last line on standard error. It knows by name what this process knows (see `registry`).
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from ngfsi import registry
from ngfsi.errors import Interrupted, NgfsiError

INTERRUPTED = 130
PLUGIN = "--plugin"


def call(
    function: str, *arguments: str | Path, more: Mapping[str, str] | None = None, timeout: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Call a function, e.g. "ngfsi.mesh.generate:main", in a child process and return what it said and how it ended.

    Args:
        more: variables of its environment.

    Raises:
        subprocess.TimeoutExpired: it took longer than `timeout` (s), and was killed.
    """
    child, options = _child(function, arguments, more)
    return subprocess.run(child, **options, capture_output=True, timeout=timeout, check=False)


def start(
    function: str, *arguments: str | Path, more: Mapping[str, str] | None = None, **options: Any
) -> subprocess.Popen[str]:
    """Start a child process that calls a function, with options of `Popen`; its standard error is a pipe."""
    child, own = _child(function, arguments, more)
    return subprocess.Popen(child, **own, stderr=subprocess.PIPE, **options)


def _child(
    function: str, arguments: Iterable[str | Path], more: Mapping[str, str] | None
) -> tuple[list[str], dict[str, Any]]:
    """Return command and options of a child, whose environment is this process's, with the same paths to modules."""
    known = (text for plugin in registry.plugins() for text in (PLUGIN, plugin))
    command = [sys.executable, "-m", "ngfsi.process", *known, function, *map(str, arguments)]
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    return command, {"env": {**os.environ, "PYTHONPATH": paths, **(more or {})}, "text": True}


def last_line(said: str, otherwise: str = "it said nothing") -> str:
    """Return the last line that a child said, or something else if it said nothing."""
    return (said.strip().splitlines() or [otherwise])[-1]


def main(*arguments: str) -> int:
    """Call a function of a module; return the exit code."""
    try:
        while arguments[0] == PLUGIN:
            registry.load(arguments[1:2])
            arguments = arguments[2:]
        module, _, name = arguments[0].partition(":")
        return int(getattr(import_module(module), name)(*arguments[1:]) or 0)
    except (NgfsiError, Interrupted) as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
