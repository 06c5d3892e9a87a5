"""Errors of a gyro held against an attitude, on any body, without dynamics."""

from twin.strapdown.compare import FAULTS as FAULTS
from twin.strapdown.compare import GyroComparison as GyroComparison
from twin.strapdown.compare import compare_gyro as compare_gyro
