"""Faults of the data, which arise after the gyro. They are detected first, masked, and reported."""

from benchctl.diagnosis.faults.clipping import rail_of
from benchctl.diagnosis.faults.fault import Fault, FoundFaults
from benchctl.diagnosis.faults.outliers import spikes_in
from benchctl.diagnosis.faults.search import faults_in

__all__ = ["Fault", "FoundFaults", "faults_in", "rail_of", "spikes_in"]
