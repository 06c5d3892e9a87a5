"""What a model gets wrong about measured logs: named causes, their evidence, size and worth."""

from twin.diagnosis.baseline import check_logs as check_logs
from twin.diagnosis.cause import Cause as Cause
from twin.diagnosis.diagnosis import Diagnosis as Diagnosis
from twin.diagnosis.diagnosis import diagnose as diagnose
from twin.diagnosis.experiment import Experiment as Experiment
from twin.diagnosis.extension import Validation as Validation
from twin.diagnosis.extension import check_new as check_new
from twin.diagnosis.extension import extend as extend
from twin.diagnosis.extension import laws_in as laws_in
from twin.diagnosis.extension import own_causes as own_causes
from twin.diagnosis.extension import validate as validate
