"""What is measured of a state: wall shear, cross-sections, pressures, flows, balances."""

from ngfsi.measure.quantities import Quantity, columns
from ngfsi.measure.wall import WallSample

__all__ = ["Quantity", "WallSample", "columns"]
