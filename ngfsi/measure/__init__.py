"""What is measured of a state: wall shear, cross-sections, pressures, flows, balances."""

from ngfsi.measure.quantities import QUANTITIES, Quantity, row
from ngfsi.measure.wall import WallSample

__all__ = ["QUANTITIES", "Quantity", "WallSample", "row"]
