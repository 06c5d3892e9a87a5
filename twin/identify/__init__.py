"""Inertia and mass moment from logs, with intervals and what the logs cannot tell."""

from twin.identify.calibrate import calibrated as calibrated
from twin.identify.every import identify_by_all as identify_by_all
from twin.identify.identification import METHODS as METHODS
from twin.identify.identification import Identification as Identification
from twin.identify.identification import Misfit as Misfit
from twin.identify.identification import identify as identify
from twin.identify.methods import Settings as Settings
