"""Where simulation and recording differ, which physics the simulation lacks, and the model that has it."""

from chatter_monitor.discrepancy.conclude import Diagnosis, conclude
from chatter_monitor.discrepancy.diagnosis import Case, examine, recorded_from

__all__ = ["Case", "Diagnosis", "conclude", "examine", "recorded_from"]
