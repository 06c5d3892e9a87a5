"""From samples to one estimate a tick, for one run or a thousand."""

from twin.estimators.aids import heading_sigma as heading_sigma
from twin.estimators.attitude_filter import AttitudeFilter as AttitudeFilter
from twin.estimators.estimator import Estimator as Estimator
from twin.estimators.estimator import OffsetEstimate as OffsetEstimate
from twin.estimators.estimator import Passthrough as Passthrough
from twin.estimators.inclinometer import InclinometerDifferences as InclinometerDifferences
from twin.estimators.multiplicative_filter import MultiplicativeFilter as MultiplicativeFilter
from twin.estimators.named import load_estimator as load_estimator
from twin.estimators.named import name_of as name_of
from twin.estimators.named import usual_estimator as usual_estimator
from twin.estimators.offset_filter import OffsetFilter as OffsetFilter
from twin.estimators.vertical_offset import VerticalOffsetFilter as VerticalOffsetFilter
