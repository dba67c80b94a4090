"""Nonparametric identification of stiffness, damping and excitation from the response alone (paper, section 3)."""

from chatter_monitor.energy.excitation import Excitation, excitation_kind
from chatter_monitor.energy.identification import Identification, identify

__all__ = ["Excitation", "Identification", "excitation_kind", "identify"]
