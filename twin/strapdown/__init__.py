"""A gyro against an attitude, on any body: what the sensors get wrong, without dynamics."""

from twin.strapdown.compare import FAULTS as FAULTS
from twin.strapdown.compare import GyroComparison as GyroComparison
from twin.strapdown.compare import compare_gyro as compare_gyro
