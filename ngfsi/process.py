"""Child processes: functions that may crash, hang or be killed are called in a Python of their own.

    python -m ngfsi.process [--plugin PLUGIN]... MODULE:FUNCTION ARGUMENT...

calls a function of a module with texts and ends with the number that it returns, 0 for None. What it refuses or fails
at is one sentence, the last line on standard error. It knows by name what this process knows (see `registry`).
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from ngfsi import registry
from ngfsi.errors import Interrupted, NgfsiError

INTERRUPTED = 130
PLUGIN = "--plugin"


def command(function: str, *arguments: str | Path) -> list[str]:
    """Return the command that calls `function`, e.g. "ngfsi.mesh.generate:main", with texts."""
    known = (text for plugin in registry.plugins() for text in (PLUGIN, plugin))
    return [sys.executable, "-m", "ngfsi.process", *known, function, *map(str, arguments)]


def environment(more: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the environment of a child: this one's, with the same paths to modules, and with what is given."""
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    return {**os.environ, "PYTHONPATH": paths, **(more or {})}


def call(function: str, *arguments: str | Path, timeout: float | None = None) -> subprocess.CompletedProcess[str]:
    """Call a function in a child process and return what it said and how it ended.

    Raises:
        subprocess.TimeoutExpired: it took longer than `timeout` (s), and was killed.
    """
    return subprocess.run(
        command(function, *arguments), env=environment(), capture_output=True, text=True, timeout=timeout, check=False
    )


def start(
    function: str, *arguments: str | Path, more: Mapping[str, str] | None = None, **options: Any
) -> subprocess.Popen[str]:
    """Start a child process that calls a function; its standard error is a pipe.

    Args:
        more: variables of its environment.
        options: of `subprocess.Popen`.
    """
    return subprocess.Popen(
        command(function, *arguments), env=environment(more), stderr=subprocess.PIPE, text=True, **options
    )


def last_line(said: str, otherwise: str) -> str:
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
