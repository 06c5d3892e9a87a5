"""Log + platform + parameters -> predicted trajectories, residuals, and what the model lacks."""

from twin.predict.compare import Comparison as Comparison
from twin.predict.compare import Transfer as Transfer
from twin.predict.compare import compare as compare
from twin.predict.compare import transfer as transfer
