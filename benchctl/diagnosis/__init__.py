"""Diagnosis: where a model and a recording disagree, and which physical effects the model lacks."""

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.gyro.predicted import predict

__all__ = ["diagnose", "predict"]
