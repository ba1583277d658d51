"""Diagnosis: where a model and a recording part, and what physics the model leaves out."""

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.gyro.predicted import predict

__all__ = ["diagnose", "predict"]
