"""Case files to begin with: registered templates, with the meaning of their keys and those that they leave out; and
files of older formats, written anew."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from typing import Any

import tomli_w

from ngfsi import registry
from ngfsi.case import formats
from ngfsi.case.case import Case, Conditions, Materials, Output, Solver, kind_of, read_case
from ngfsi.config.describe import json_schema, meaning
from ngfsi.config.model import ConfigModel, dimension_of_field, keys_of
from ngfsi.errors import NgfsiError, OutputError
from ngfsi.store.disk import explained, replace_file
from ngfsi.units import from_si, readable

GROUP = "ngfsi.templates"
SCHEMA = "ngfsi.schema.json"
FILE = re.compile(r"^file = .*$", re.MULTILINE)
NAME = re.compile(r"^(?=name = )", re.MULTILINE)
HEADER = re.compile(r"\[+([\w.]+)\]+\s*$")
KEY = re.compile(r"\w+")
WIDTH = 120
OPTIONAL: dict[str, type[ConfigModel]] = {"conditions": Conditions, "solver": Solver, "output": Output}
"""Tables that a case may lack."""


def new(kind: str, path: Path, file: Path | None = None) -> str:
    """Write the case file of a template, beside it the schema of case files and the example file that it needs.

    Args:
        file: mesh or image in place of the example.

    Returns:
        Why the case is not accepted as it is, which it may be with a `file`; else nothing.

    Raises:
        NgfsiError: the template is unknown.
        OutputError: the case file is there already, or cannot be written, or the template needs no file.
    """
    template = registry.find(GROUP, kind, "template")
    if path.exists():
        raise OutputError(f"'{path}' is there already: name another file with --output")
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        text = template(None if file else path.parent)
        if file:
            if not FILE.search(text):
                raise OutputError(f"the template '{kind}' needs no file: leave out --file, or take 'mesh' or 'image'")
            text = FILE.sub(lambda _: _line("file", str(file.absolute())), text)
        text = NAME.sub(f"{_line(formats.KEY, formats.FORMAT)}\n", text, count=1)
        text = f"#:schema {SCHEMA}\n{text}"
        path.write_text(text, encoding="utf-8")
        (path.parent / SCHEMA).write_text(json.dumps(json_schema(Case), indent=1) + "\n", encoding="utf-8")
        try:
            case = Case.from_toml(path)
        except NgfsiError as error:
            return str(error)
        path.write_text(commented(text, case), encoding="utf-8")
    return ""


def migrate(path: Path, output: Path) -> list[str]:
    """Write a case file in the present format; return what was changed, in sentences.

    Raises:
        CaseError: the file cannot be read, is not TOML, or of a format that this ngfsi does not know.
        OutputError: the output is there already, or cannot be written.
    """
    new, said = formats.migrated(read_case(path)[0])
    if output.exists():
        raise OutputError(f"'{output}' is there already: name another file with --output")
    replace_file(output, new.encode())
    return said


def commented(text: str, case: Case) -> str:
    """Return the text of a case with the meaning of each key beside it, and at the end of each table the keys that it
    leaves out, with their defaults, as comments."""
    written: list[str] = []
    found = set()
    for header, lines in _tables(text.splitlines()):
        found.add(header.partition(".")[0])
        model = _model(case, header)
        given = {match[0] for line in lines if (match := KEY.match(line))}
        if model is Materials:
            given |= set(Materials.model_fields) - {kind_of(region) for region in case.geometry.solids}
        written += [_explained(line, model) for line in lines]
        written += [*(_left_out(model, given) if header and model else ()), ""]
    for name, model in OPTIONAL.items():
        if name not in found:
            written += [f"# [{name}]", *_left_out(model, set()), ""]
    return "\n".join(written)


def _tables(lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield each table's name ("" before the first) and lines, with the comments right above it, without empty ends."""
    starts = [0]
    for number, line in enumerate(lines):
        if HEADER.match(line):
            above = len(list(takewhile(lambda one: one.startswith("#"), reversed(lines[:number]))))
            starts.append(number - above)
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        part = "\n".join(lines[start:end]).rstrip().splitlines()
        yield next((match[1] for line in part if (match := HEADER.match(line))), ""), part


def _model(case: Case, header: str) -> type[ConfigModel] | None:
    """Return the class of the part of a case that stands under a header, if it is a table of keys."""
    part: Any = case
    for name in filter(None, header.split(".")):
        part = part.get(name) if isinstance(part, dict) else getattr(part, name, None)
        part = part[-1] if isinstance(part, tuple) and part else part
    return type(part) if isinstance(part, ConfigModel) else None


def _explained(line: str, model: type[ConfigModel] | None) -> str:
    """Return a line `key = value` with the key's meaning behind it, where there is room."""
    key = (keys_of(model).get(line.partition(" = ")[0]) if model else None) if KEY.match(line) else None
    said = meaning(model, key.field) if model and key else ""
    whole = f"{line}  # {said}"
    return whole if said and "#" not in line and len(whole) <= WIDTH else line


def _left_out(model: type[ConfigModel], given: set[str]) -> Iterator[str]:
    """Yield the fields of a model whose keys are not given, as comments."""
    known = {keys_of(model)[key].field for key in given if key in keys_of(model)}
    for name, field in model.model_fields.items():
        if name in known or isinstance(field.default, ConfigModel):
            continue
        dimension = dimension_of_field(model, name)
        value = None if field.is_required() or field.default_factory else field.default
        unit = readable(dimension, value) if dimension else ""
        key = f"{name}_{unit}" if unit else name
        shown = _line(key, _in(value, unit)) if value not in (None, ()) else f"{key} ="
        said = meaning(model, name)
        whole = f"# {shown}  # {said}" if said else f"# {shown}"
        yield whole if len(whole) <= WIDTH else f"{whole[: WIDTH - 3].rpartition(' ')[0]} ..."


def _in(value: Any, unit: str) -> Any:
    if isinstance(value, tuple):
        return [_in(one, unit) for one in value]
    return float(f"{from_si(value, unit):.6g}") if unit else value


def _line(key: str, value: Any) -> str:
    return " ".join(tomli_w.dumps({key: value}).replace(",\n", ", ").split())
