"""Whether a log was read rightly: units, axes, signs, quaternions, time bases, clocks."""

from twin.conventions.advice import ConventionAdvice as ConventionAdvice
from twin.conventions.advice import convention_advice as convention_advice
from twin.conventions.evidence import ConventionFinding as ConventionFinding
from twin.conventions.search import check_conventions as check_conventions
from twin.conventions.search import corrected as corrected
