"""What a model gets wrong about measured logs: named causes, their evidence, size and worth."""

from twin.diagnose.baseline import check_logs as check_logs
from twin.diagnose.cause import Cause as Cause
from twin.diagnose.diagnosis import Diagnosis as Diagnosis
from twin.diagnose.diagnosis import diagnose as diagnose
from twin.diagnose.experiment import Experiment as Experiment
from twin.diagnose.extension import Validation as Validation
from twin.diagnose.extension import check_new as check_new
from twin.diagnose.extension import extend as extend
from twin.diagnose.extension import laws_in as laws_in
from twin.diagnose.extension import validate as validate
