"""Command line: `ngfsi new`, `check`, `run`, `resume`, `gradient`, `calibrate`, `study`, `verify`, `report` and others.

Whatever goes wrong ends in one sentence on standard error. Exit codes: 0 done, 2 the input is at fault, 3 the
equations could not be solved, 4 stopped before its end as asked (--max-wall, a file STOP), 130 interrupted by Ctrl-C,
143 by SIGTERM, 1 an error of the program itself. After 4, 130 and 143 `ngfsi resume` goes on.
"""

from __future__ import annotations

import json
import signal
import sys
import tempfile
import tomllib
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ngfsi import registry
from ngfsi.errors import CaseError, Interrupted, NgfsiError, OutputError, unknown
from ngfsi.parallel.ranks import Ranks, all_ranks, launched
from ngfsi.process import INTERRUPTED
from ngfsi.units import Shown, seconds

if TYPE_CHECKING:
    from ngfsi.case import Case
    from ngfsi.store import StoredRun

LEVELS = ("demo", "paper", "fine")
"""Of a study whose module has no LEVELS of its own."""
SHARED = ("run", "resume")
"""Commands of which several ranks share the work."""

app = typer.Typer(
    name="ngfsi",
    help="High-order 3-D fluid-structure interaction of veins and soft tissue.",
    epilog="Begin with: ngfsi study compare_tissues --level demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def parse_duration(text: str) -> float:
    """Return the seconds in `--max-wall`.

    Raises:
        CaseError: it is no duration.
    """
    try:
        return seconds(text)
    except ValueError as error:
        raise CaseError(f"--max-wall {error}") from None


def _load(plugins: list[str] | None) -> None:
    registry.load(plugins or ())


Plugin = Annotated[
    list[str] | None,
    typer.Option(
        "--plugin", metavar="FILE.py", callback=_load,
        help="Python file with geometries, laws or conditions of the case; may be given again.",
    ),
]  # fmt: skip
"""For every command that reads cases; what is done with it is done before the command begins."""
Folder = Annotated[Path, typer.Argument(help="Folder of a run.", metavar="RUN")]
Changes = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a value of the case; may be given again."),
]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="Folder of the results.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
MaxWall = Annotated[
    float | None,
    typer.Option(
        parser=parse_duration, metavar="DURATION",
        help="Time on the clock within which to stop, e.g. 2h or 90min; resume goes on.",
    ),
]  # fmt: skip

Errors = Annotated[bool, typer.Option("--error", help="Estimate the error from space and time.")]
Refine = Annotated[
    int, typer.Option("--refine", min=0, metavar="TIMES", help="Refine the mesh so often, where the error is.")
]  # fmt: skip


@app.command()
def run(
    case: Annotated[Path, typer.Argument(help="Case file in TOML.", metavar="CASE.toml")],
    output: Output = None,
    quiet: Quiet = False,
    max_wall: MaxWall = None,
    changes: Changes = None,
    error: Errors = False,
    refine: Refine = 0,
    _: Plugin = None,
) -> None:
    """Compute a case.

    The results go to runs/<name of the case>.

    With --error the end in elements of one order more, and one more run with steps of double size, tell the error of
    loss and wall shear stress: errors.csv.

    With --refine 2 the case is computed again on two refined meshes, in refined_1 and refined_2, each finer where
    elements of another order differ: layers of straight veins and calves, or tetrahedra of an external mesh. --error
    then is of the last.

    Keys of --set are those of the case file, with their units.

    Example: ngfsi run calf.toml --set time.step_ms=10 --set 'materials.tissue={set="neo_hookean_likely"}'
    """
    from ngfsi.case.plausible import implausible
    from ngfsi.run import run as compute

    chosen = _chosen(case, changes)
    for sentence in implausible(chosen):
        _say(f"warning: {sentence}")
    folder = output or Path("runs") / chosen.name
    with _interruptible(folder):
        if refine:
            from ngfsi.run.refine import check_refinable

            check_refinable(chosen)
        last = _followed(folder, quiet, max_wall, error, refine, lambda **how: compute(chosen, folder, **how))
    _point_to(last, quiet)


@app.command()
def new(
    kind: Annotated[
        str, typer.Argument(help="calf, vein, wall, rigid, section, solid, mesh or image, and others' own.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Case file to write; default <kind>.toml.", show_default=False)
    ] = None,
    file: Annotated[
        Path | None, typer.Option("--file", help="Your mesh or image, for 'mesh' and 'image'; default: an example.")
    ] = None,
    _: Plugin = None,
) -> None:
    """Write a case file to begin with.

    With the meaning of each key, the keys that it leaves out, and the schema by which editors complete and check it.

    Example: ngfsi new vein && ngfsi run vein.toml
    """
    from ngfsi.run.new import new as write

    path = output or Path(f"{kind}.toml")
    if missing := write(kind, path, file):
        typer.echo(f"The case is in '{path}', and not complete yet: {missing}")
    else:
        typer.echo(f"The case is in '{path}': look at it with `ngfsi check {path}`, compute it with `ngfsi run {path}`")


@app.command()
def migrate(
    case: Annotated[Path, typer.Argument(help="Case file of an older format.", metavar="CASE.toml")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File to write; default <name>-<format>.toml.", show_default=False),
    ] = None,
) -> None:
    """Write a case file of an older format in the present one.

    Comments stay. What is changed is said, and the old file is left as it is.

    Example: ngfsi migrate leg.toml -o leg-new.toml
    """
    from ngfsi.case.formats import FORMAT
    from ngfsi.run.new import migrate as write

    path = output or case.with_name(f"{case.stem}-{FORMAT}.toml")
    for sentence in write(case, path):
        typer.echo(sentence)
    typer.echo(f"The case in format {FORMAT} is in '{path}'")


@app.command()
def schema(_: Plugin = None) -> None:
    """Print the JSON schema of case files.

    A file whose first line is `#:schema ngfsi.schema.json` is completed and checked by editors that know TOML.

    Example: ngfsi schema > ngfsi.schema.json
    """
    from ngfsi.case import Case
    from ngfsi.config.describe import json_schema

    typer.echo(json.dumps(json_schema(Case), indent=1))


@app.command()
def check(
    case: Annotated[Path, typer.Argument(help="Case file in TOML.", metavar="CASE.toml")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of picture and mesh; default runs/check-<name>.")
    ] = None,
    changes: Changes = None,
    _: Plugin = None,
) -> None:
    """Look at the mesh of a case before it is run.

    Regions, boundaries, openings, quality, unknowns and likely costs; a picture and a VTU file. Nothing is solved.

    Example: ngfsi check vein.toml
    """
    from ngfsi.report.terminal import console
    from ngfsi.run.check import check as look

    chosen = _chosen(case, changes)
    with _interruptible(output or Path("runs")):
        found = look(chosen, output or Path("runs") / f"check-{chosen.name}")
    console().print(found.tables())


@app.command()
def resume(
    folder: Folder, quiet: Quiet = False, max_wall: MaxWall = None, error: Errors = False, refine: Refine = 0,
    _: Plugin = None,
) -> None:  # fmt: skip
    """Go on with a run that was stopped or killed.

    From its last checkpoint, with the results of a run that was never stopped.

    With --error and --refine as for ngfsi run, also of a run that is complete; what there is of further runs goes on.

    Example: ngfsi resume runs/calf --max-wall 2h
    """
    from ngfsi.run import completed
    from ngfsi.run import resume as go_on
    from ngfsi.store.folder import ERRORS

    with _interruptible(folder):
        if error and not refine and (folder / ERRORS).exists():
            raise OutputError(f"'{folder}' holds a run with its errors: there is nothing to resume")

        def compute(**how: Any) -> StoredRun:
            done = completed(folder) if error or refine else None
            return done or go_on(folder, **how)

        last = _followed(folder, quiet, max_wall, error, refine, compute)
    _point_to(last, quiet)


@app.command()
def gradient(
    case: Annotated[Path, typer.Argument(help="Case file in TOML.", metavar="CASE.toml")],
    of: Annotated[
        str,
        typer.Option(
            "--of",
            metavar="QUANTITY",
            help="Column of series.csv without its unit; with _mean, _change or _loss its mean over the window, or its "
            "change or the part lost from start to end; alone its value at the end.",
        ),
    ],
    by: Annotated[
        str,
        typer.Option("--by", metavar="PARAMETERS", help="Keys of the case, with commas; of tables all their numbers."),
    ] = "materials,loads",
    window: Annotated[
        str, typer.Option(metavar="START,END", help="Times [s] over which a mean is taken; default the whole run.")
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder of gradient.csv and a bar chart; default runs/gradient-<name>."),
    ] = None,
    quiet: Quiet = False,
    changes: Changes = None,
    _: Plugin = None,
) -> None:
    """Compute what a result depends on.

    Derivatives and elasticities (percent per percent) of a quantity by any number of parameters, for the price
    of about two runs, by a discrete adjoint of the whole run.

    Example: ngfsi gradient calf.toml --of sawss_mean --window 0.5,1 --by materials.tissue,loads.inlet_flow
    """
    from ngfsi.gradient import command
    from ngfsi.report.terminal import console

    chosen = _chosen(case, changes)
    folder = output or Path("runs") / f"gradient-{chosen.name}"
    with _interruptible(folder):
        found = command.gradient(chosen, of, by, window, folder, (lambda _: None) if quiet else _say)
    console().print(command.table(found))
    typer.echo(f"The numbers and a chart are in '{folder}'")


@app.command()
def calibrate(
    case: Annotated[Path, typer.Argument(help="Case file in TOML.", metavar="CASE.toml")],
    data: Annotated[
        Path,
        typer.Option(
            metavar="FILE.csv",
            help="Rows by time_s or skin_pressure_mmHg, columns as of series.csv with their standard errors: "
            "area_z05_mm2,area_z05_error_mm2.",
        ),
    ],
    by: Annotated[str, typer.Option("--by", metavar="PARAMETERS", help="Keys of the case, with commas.")],
    bounds: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=LOW,HIGH", help="Between which a parameter is looked for; may be given again."),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=MEAN,SD", help="What is known of a parameter before; may be given again."),
    ] = None,
    check: Annotated[
        int, typer.Option(min=0, metavar="N", help="Runs of parameters drawn from what the data leave open.")
    ] = 0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder of the report; default runs/calibrate-<name>.", show_default=False),
    ] = None,
    quiet: Quiet = False,
    changes: Changes = None,
    _: Plugin = None,
) -> None:
    """Find parameters from measured values.

    By least squares, with standard deviations, correlations and what the data do not tell. The search begins with the
    values of the case. Columns with a gradient are areas of the lumen, flows, pressures and wall shear stress, alone or
    since the start with _loss or _change. Keys of --bounds and --prior carry their units.

    Example: ngfsi calibrate calf.toml --data areas.csv --by materials.tissue.K,materials.wall.young --prior
    materials.wall.young_MPa=0.6,0.2
    """
    from ngfsi.gradient import calibrate as command
    from ngfsi.report.terminal import console

    chosen = _chosen(case, changes)
    folder = output or Path("runs") / f"calibrate-{chosen.name}"
    say = (lambda _: None) if quiet else _say
    with _interruptible(folder):
        found = command.run(chosen, data, by, bounds or (), prior or (), folder, say, check)
    console().print(command.table(found))
    typer.echo(f"The report and the calibrated case are in '{folder}'")


@app.command()
def design(
    case: Annotated[Path, typer.Argument(help="Case file in TOML.", metavar="CASE.toml")],
    mean: Annotated[str, typer.Option(help="Mean pressure over the skin at most, with its unit.", metavar="12mmHg")],
    high: Annotated[str, typer.Option(help="Highest pressure of a cuff, with its unit.", metavar="24mmHg")],
    of: Annotated[
        str, typer.Option("--of", metavar="QUANTITY", help="A quantity with a gradient, or sawss_least.")
    ] = "sawss",
    cuffs: Annotated[str, typer.Option(help="Rings along the segment by sectors around it.")] = "4x14",
    jump: Annotated[str, typer.Option(help="Largest difference of neighbours; default: any.", metavar="6mmHg")] = "",
    loss: Annotated[float, typer.Option(help="Fraction of the lumen's volume that may be lost.", min=0, max=1)] = 0.25,
    section_loss: Annotated[
        float, typer.Option(help="Fraction of the area of each of eleven sections that may be lost.", min=0, max=1)
    ] = 1.0,
    times: Annotated[
        str,
        typer.Option(
            metavar="0,0.5,1,1.5,2",
            help="Times of a cycle (s) at which each cuff's pressure is free; default: the vein is at rest.",
        ),
    ] = "",
    also: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="The same pressures are for the case with this value, too, and the least "
            "of all is to be large; may be given again.",
        ),
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option(help="Begin with the pressures.csv of a design.", metavar="pressures.csv", show_default=False),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder of the pressures; default runs/design-<name>.", show_default=False),
    ] = None,
    quiet: Quiet = False,
    changes: Changes = None,
    _: Plugin = None,
) -> None:
    """Find pressures on the skin by gradients.

    Which pressures of cuffs that cover the skin, of a bounded mean, make a quantity of the vein at rest largest; with
    --times, which cycles of pressures its mean over the last cycle of the run.

    Example: ngfsi design calf.toml --mean 12mmHg --high 24mmHg
    """
    from ngfsi.gradient import design_command as command
    from ngfsi.gradient.design import Limits

    chosen = _chosen(case, changes)
    limits = Limits(
        mean=command.pressure(mean, "--mean"), high=command.pressure(high, "--high"), loss=loss,
        section_loss=section_loss, jump=command.pressure(jump, "--jump") if jump else float("inf"),
    )  # fmt: skip
    folder = output or Path("runs") / f"design-{chosen.name}"
    others = [_chosen(case, [*(changes or ()), one]) for one in also or ()]
    with _interruptible(folder):
        say = (lambda _: None) if quiet else _say
        found = command.design(chosen, of, cuffs, limits, folder, say, others, start, times)
    typer.echo(command.sentence(found, of))
    typer.echo(f"The pressures and the case under them are in '{folder}'")


@app.command()
def study(
    name: Annotated[str, typer.Argument(help="Name of the study, e.g. compare_tissues.")],
    level: Annotated[
        str, typer.Option(help="How finely to compute: demo, paper, fine; minutes, an hour, a day. A few have others.")
    ] = "demo",
    output: Output = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Compute again what failed.")] = False,
    quiet: Quiet = False,
    _: Plugin = None,
) -> None:
    """Compute the cases of a study and report.

    The results go to runs/<study>-<level>.

    Runs that are finished, or failed, are reused, so that an interrupted study goes on where it was.

    Example: ngfsi study compare_tissues --level paper
    """
    compute = registry.find("ngfsi.studies", name, "study", OutputError)
    levels = getattr(sys.modules[compute.__module__], "LEVELS", LEVELS)
    if level not in levels:
        raise OutputError(unknown(f"level of the study {name}", level, levels))
    folder = output or Path("runs") / f"{name}-{level}"
    if retry_failed:
        from ngfsi.study import forget_failed

        for path in forget_failed(folder):
            _say(f"'{path}' failed and is computed again")
    with _interruptible(folder):
        report = compute(level, folder, quiet)
    typer.echo(f"The report is in '{report}'")


@app.command()
def verify(
    names: Annotated[list[str] | None, typer.Argument(help="Benchmarks; default all.", metavar="[NAME]...")] = None,
    level: Annotated[Literal["ci", "full"], typer.Option(help="Minutes, or hours with finer levels.")] = "ci",
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of verification.md.")] = Path("runs/verify"),
    quiet: Quiet = False,
) -> None:
    """Hold ngfsi against exact solutions and published values.

    Prints a table, writes verification.md with figures from all results so far, and fails if a benchmark does.

    Example: ngfsi verify poiseuille lame --level full
    """
    from ngfsi.report.terminal import console
    from ngfsi.solve.initial import silent
    from ngfsi.verify import engine
    from ngfsi.verify.page import FOLDER, terminal_table, write_page

    results = []
    with _interruptible(output):
        for name, module in engine.chosen(names or ()).items():
            result = engine.verify(name, module, level, silent if quiet else _say)
            result.write(output / FOLDER)
            results.append(result)
        page = write_page(output)
    console().print(terminal_table(results))
    typer.echo(f"The page is '{page}'")
    if failed := [result.name for result in results if not result.passed]:
        raise engine.VerificationError(f"not within their tolerance: {', '.join(failed)}")


@app.command()
def bench(
    names: Annotated[
        list[str] | None, typer.Argument(help="Cases; default the short ones.", metavar="[NAME]...")
    ] = None,
    against: Annotated[
        list[str] | None, typer.Option(help="Variant to compare with; may be given again.", metavar="VARIANT")
    ] = None,
    pairs: Annotated[int, typer.Option(min=1, help="Runs of each, by turns.")] = 5,
    steps: Annotated[int | None, typer.Option(min=1, help="Run only the first steps, and extrapolate.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the results.")] = Path("runs/bench"),
) -> None:
    """Measure time, memory and counts of whole runs.

    Prints medians and a variant's ratios to the baseline, with their spread; writes every run as JSON, and a
    figure of the seconds by kind of work.

    Example: ngfsi bench calf-demo --against textbook-same-size --pairs 2 --steps 5
    """
    from ngfsi.bench import engine
    from ngfsi.report.figures import stacked_bars
    from ngfsi.report.terminal import console

    variants = engine.named("VARIANTS", against) if against else {}
    with _interruptible(output):
        for name, case in engine.named("CASES", names or ()).items():
            changed = {label: change(case) for label, change in variants.items()}
            found = engine.compare(name, case, changed, pairs, steps, _say, output)
            path = found.write(output)
            stacked_bars(found.phases(), Shown("wall time", "s"), path.with_suffix(".png"))
            console().print(found.table())
            typer.echo(f"The numbers are in '{path}'")


@app.command()
def materials() -> None:
    """List the parameter sets of materials.

    Initial moduli, and what is odd about them.
    """
    from ngfsi.report import terminal as summary

    summary.console().print(summary.materials())


@app.command()
def info(
    folder: Annotated[Path | None, typer.Argument(help="Folder of a run.", metavar="RUN")] = None, _: Plugin = None
) -> None:
    """Show a run, or this installation.

    Of RUN: how it ended, mesh, timings, last values; without RUN: versions and solver.

    Example: ngfsi info runs/calf
    """
    from ngfsi.report import terminal as summary
    from ngfsi.store import open_run

    summary.console().print(summary.run_summary(open_run(folder)) if folder else summary.installation())


@app.command()
def cite(folder: Folder, _: Plugin = None) -> None:
    """Print what to cite for a run, and how to repeat it.

    Of methods and materials only those that it used.

    Example: ngfsi cite runs/calf
    """
    from ngfsi.report.citing import citations, repeat_commands
    from ngfsi.store import open_run

    run = open_run(folder)
    for heading, references in citations(run).items():
        typer.echo("\n".join([f"{heading}:", *(f"  - {reference}" for reference in references)]))
    typer.echo("\n".join(["to repeat it:", *(f"  {command}" for command in repeat_commands(run))]))


@app.command()
def export(
    folder: Folder,
    time: Annotated[float, typer.Option(help="Time [s]; the fields stored nearest to it are taken.")],
    fmt: Annotated[str, typer.Option("--format", "-f", help="xdmf, vtu, gmsh or abaqus (the mesh alone).")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="File to write; default in RUN/export.")] = None,
    _: Plugin = None,
) -> None:
    """Write the fields at one time for other programs.

    The mesh is the deformed one.

    Example: ngfsi export runs/calf --time 1.0 --format xdmf
    """
    from ngfsi.store import open_run
    from ngfsi.store.export import export as write

    path, found = write(open_run(folder), time, fmt, output)
    typer.echo(f"The fields at {found:g} s are in '{path}'")


@app.command()
def animate(
    folder: Folder,
    output: Annotated[Path, typer.Option("--output", "-o", help="GIF or MP4 to write.")] = Path("runs/vein.gif"),
    _: Plugin = None,
) -> None:
    """Draw the vein over time, as a GIF or MP4.

    Wall shear stress on the deforming inner wall.

    Example: ngfsi animate runs/calf -o vein.mp4
    """
    from ngfsi.report.render import animation
    from ngfsi.store import open_run

    if failure := animation(open_run(folder), output):
        raise OutputError(failure)
    typer.echo(f"The animation is '{output}'")


@app.command()
def view(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders of runs, to be compared side by side.", metavar="RUN...")
    ],
    port: Annotated[int, typer.Option(help="Port of the page; 0: any that is free.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
    _: Plugin = None,
) -> None:
    """Look at runs on a local page.

    Time, quantity, planes of cut; a click on a place shows its history. Needs trame: pip install 'ngfsi[view]'.

    Example: ngfsi view runs/calf
    """
    from ngfsi.report.view import serve

    serve(folders, port, browser)


@app.command()
def report(
    folders: Annotated[list[Path], typer.Argument(help="Folders of runs.", metavar="RUN...")],
    output: Annotated[Path, typer.Option("--output", "-o", help="HTML file to write.")] = Path("runs/report.html"),
    claims: Annotated[Path | None, typer.Option(help="Printed numbers in TOML; default those of the studies.")] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Folder for the charts as SVG, PDF and PNG.", metavar="FOLDER")
    ] = None,
    width_mm: Annotated[
        float | None,
        typer.Option(min=50, max=500, help="Width of these, by default that of a page; a column has 80 to 90."),
    ] = None,
    _: Plugin = None,
) -> None:
    """Show runs in one HTML file.

    Of one run or several compared: setup, results with their errors, interactive charts, the vein to turn.

    Example: ngfsi report runs/demo/m_s1 runs/demo/n_likely -o compared.html
    """
    from ngfsi.report.html import figures as draw
    from ngfsi.report.html import report as write
    from ngfsi.store.disk import explained
    from ngfsi.units import to_si

    if width_mm and not figures:
        raise OutputError("--width-mm is the width of figures: name a folder for them with --figures")
    if claims:
        with explained(claims, "read"):
            printed = tomllib.loads(claims.read_text(encoding="utf-8"))
    else:
        found = registry.everything("ngfsi.claims", "function that returns printed numbers").values()
        printed = {key: value for claims_of in found for key, value in claims_of().items()}
    typer.echo(f"The report is '{write(folders, output, printed)}'")
    if figures:
        width = {"width": to_si(width_mm, "mm")} if width_mm else {}
        typer.echo(f"{len(draw(folders, figures, **width))} figures are in '{figures}'")


OWN = (
    "run", "new", "migrate", "schema", "check", "resume", "gradient", "study", "verify", "bench", "materials", "info",
    "cite", "export", "animate", "view", "report",
)  # fmt: skip
"""The commands above; others are registered by packages."""


def parse_change(text: str) -> tuple[str, Any]:
    """Return key and value of `key=value`; a value that is not TOML is text.

    Raises:
        CaseError: there is no key or no value.
    """
    key, equals, value = text.partition("=")
    if not key.strip() or not equals or not value.strip():
        raise CaseError(f"'{text}' is not understood: write KEY=VALUE, e.g. time.step_ms=10")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def _chosen(path: Path, changes: list[str] | None) -> Case:
    """Return the case in a file with the values of --set."""
    from ngfsi.case import Case

    return Case.from_toml(path).replace(**dict(map(parse_change, changes or ())))


def _followed(
    folder: Path, quiet: bool, max_wall: float | None, error: bool, refine: int, compute: Callable[..., StoredRun]
) -> Path:
    """Compute a run, those on refined meshes and the errors of the last, print these; return the last one's folder."""
    if not (error or refine):
        compute(quiet=quiet, max_wall=max_wall)
        return folder
    from ngfsi.report import terminal
    from ngfsi.run.interrupts import time_left

    left = time_left(max_wall)
    further = f"{f' --refine {refine}' if refine else ''}{' --error' if error else ''}"
    resumed_by = f"ngfsi resume {folder}{further}"

    def how() -> dict[str, Any]:
        return {"quiet": quiet, "max_wall": left()}

    found = compute(resumed_by=resumed_by, **how())
    if refine:
        from ngfsi.run.estimate import at_end
        from ngfsi.run.refine import refine as compute_refined

        runs = [found, *compute_refined(found, refine, say=_say, resumed_by=resumed_by, **how())]
        terminal.console().print(terminal.refinements(runs, [at_end(run) for run in runs]))
        found = runs[-1]
    if error:
        from ngfsi.run.estimate import estimate

        estimate(found, say=_say, resumed_by=resumed_by, **how())
        terminal.console().print(terminal.errors(found))
    return found.path


def _point_to(folder: Path, quiet: bool) -> None:
    if not quiet:
        typer.echo(
            f"The results are in '{folder}': see them with `ngfsi info {folder}`, or {folder}/volume.pvd in ParaView"
        )


@contextmanager
def _interruptible(folder: Path) -> Iterator[None]:
    """Turn Ctrl-C inside the block into a sentence about where the results so far lie."""
    try:
        yield
    except Interrupted as error:
        _say(str(error))
        raise typer.Exit(error.exit_code) from None
    except KeyboardInterrupt:
        kept = f"; what was computed is in '{folder}'" if folder.exists() else ""
        _say(f"interrupted{kept}")
        raise typer.Exit(INTERRUPTED) from None


def _say(sentence: str) -> None:
    print(f"ngfsi: {sentence}", file=sys.stderr)


def _unexpected(error: Exception) -> None:
    with tempfile.NamedTemporaryFile("w", prefix="ngfsi-", suffix=".txt", delete=False, encoding="utf-8") as file:
        traceback.print_exc(file=file)
    _say(f"an error of the program itself, {type(error).__name__}: {error}; please report it with '{file.name}'")


def main(arguments: list[str] | None = None) -> None:
    """Entry point; always ends in SystemExit. Under mpirun rank 0 does what follows, the others what it orders."""
    try:
        ranks = all_ranks()
    except NgfsiError as error:
        if launched()[0] == 0:
            _say(str(error))
        sys.exit(error.exit_code)
    if not ranks.leads:
        _serve(ranks)
        sys.exit(0)
    ranks.workers_ready = True
    given = sys.argv[1:] if arguments is None else arguments
    try:
        _refuse_ranks(ranks, given)
        if next(iter(given), "--help") not in OWN:
            _add_commands()
        app(given)
    except NgfsiError as error:
        _say(str(error))
        sys.exit(error.exit_code)
    except Exception as error:
        _unexpected(error)
        sys.exit(1)
    finally:
        ranks.shutdown()


@cache
def _add_commands() -> None:
    """Add the commands that packages register, which are loaded only if none of those above is asked for."""
    for name, function in registry.everything("ngfsi.commands", "command").items():
        app.command(name)(function)


def _serve(ranks: Ranks) -> None:
    """Work for rank 0, which alone heeds signals."""
    from ngfsi.run.worker import Worker

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    Worker(ranks).work()


def _refuse_ranks(ranks: Ranks, arguments: list[str]) -> None:
    """Raise CaseError for what several ranks cannot do together."""
    command = next(iter(arguments), "")
    if ranks.size > 1 and command not in SHARED:
        raise CaseError(f"mpirun is for ngfsi {' and '.join(SHARED)}: start 'ngfsi {command}' without it")


if __name__ == "__main__":
    main()
