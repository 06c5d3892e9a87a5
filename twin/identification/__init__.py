"""Inertia and mass moment from logs, with intervals and identifiability."""

from twin.identification.identification import METHODS as METHODS
from twin.identification.identification import Identification as Identification
from twin.identification.identification import Misfit as Misfit
from twin.identification.identification import calibrated as calibrated
from twin.identification.identification import identify as identify
from twin.identification.identification import identify_by_all as identify_by_all
from twin.identification.methods import Settings as Settings
