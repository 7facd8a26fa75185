"""What acts on the system: loads, openings, supports and prescribed motions, each one object of one protocol."""

from ngfsi.conditions.condition import Condition, ConditionModel, OpeningModel, Setup, WithValue
from ngfsi.conditions.contact import Contact, ContactModel
from ngfsi.conditions.loads import BloodReference, BodyForce, BodyForceModel, Cuff, PressureOn, StockingModel
from ngfsi.conditions.openings import (
    FlowOpening,
    FreeOpening,
    PressureOpening,
    ResistanceOpening,
    WindkesselOpening,
)
from ngfsi.conditions.supports import DisplacementModel, Ends, GivenMeshMotion, GivenVelocity, SkinMotion

__all__ = [
    "BloodReference", "BodyForce", "BodyForceModel", "Condition", "ConditionModel", "Contact", "ContactModel", "Cuff",
    "DisplacementModel", "Ends", "FlowOpening", "FreeOpening", "GivenMeshMotion", "GivenVelocity", "OpeningModel",
    "PressureOn", "PressureOpening", "ResistanceOpening", "Setup", "SkinMotion", "StockingModel",
    "WindkesselOpening", "WithValue",
]  # fmt: skip
