"""The conditions of a case on its domain."""

from __future__ import annotations

from collections.abc import Collection

from ngfsi.case import Case
from ngfsi.conditions import BloodReference, Condition, Contact, Ends, OpeningModel, PressureOn, SkinMotion
from ngfsi.conditions.loads import SKIN
from ngfsi.conditions.membranes import OnBoundary
from ngfsi.conditions.openings import NOTHING
from ngfsi.errors import CaseError
from ngfsi.mesh.domain import Domain


def references_of(case: Case, domain: Domain) -> dict[str, BloodReference]:
    """Return by vessel what sets the reference pressure of its blood: the first known pressure at an opening, outlets
    first, or 0."""
    one_way = case.conditions.coupling == "one_way"
    found = {}
    for vessel in (one for one in domain.vessels if one.lumen):
        given = (case.loads.opening(name) for name in (*vessel.outlets, *vessel.inlets))
        known = (curve for model in given if model and (curve := model.reference()))
        found[vessel.name] = BloodReference(vessel, domain, next(known, NOTHING), one_way=one_way)
    return found


def conditions_of(case: Case, domain: Domain, taken: Collection[str] = ()) -> list[Condition]:
    """Return the other conditions of a case.

    Args:
        taken: names of conditions that others take the place of.

    Raises:
        CaseError: one does not fit the geometry, or an opening has none.
    """
    loads, given = case.loads, case.conditions
    found: list[Condition] = []
    if given.skin_displacement:
        found.append(SkinMotion(domain, given.skin_displacement))
    elif domain.has_boundary(SKIN):
        found.append(PressureOn("on the skin", domain, (SKIN,), loads.skin_pressure))
        for n, cuff in enumerate(loads.cuffs, start=1):
            found.append(PressureOn(f"in cuff {n}", domain, (SKIN,), cuff.pressure, cuff.weight()))
    found.append(Ends(domain, given.ends))
    found += [OnBoundary(domain, membrane) for membrane in case.materials.membranes]
    if given.contact:
        found.append(Contact(domain, given.contact))
    found += [model.condition(domain, f"{model.kind} {n}") for n, model in enumerate(loads.further, start=1)]
    for vessel in domain.vessels:
        if vessel.lumen is None:
            name = f"in {vessel.interface}"
            found.append(PressureOn(name, domain, (vessel.interface,), loads.outlet_pressure))
        for name in vessel.openings:
            if name not in taken:
                found.append(_opening(case, name).condition(domain, name, vessel))
    return [condition for condition in found if condition.name not in taken]


def _opening(case: Case, name: str) -> OpeningModel:
    found = case.loads.opening(name)
    if found is None:
        raise CaseError(
            f'the opening \'{name}\' has no condition: write [loads.openings.{name}] with kind = "flow", "pressure", '
            '"free", "resistance" or "windkessel"'
        )
    return found
