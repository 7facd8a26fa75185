"""What a run leaves: its folder, fields, progress, exports and figures."""

from ngfsi.output.folder import RunFolder
from ngfsi.output.stored import StoredRun, open_run

__all__ = ["RunFolder", "StoredRun", "open_run"]
