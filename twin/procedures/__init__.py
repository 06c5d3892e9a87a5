"""Balancing as a laboratory does it: phases, checks before each, a statement of what is left."""

from twin.procedures.balancing import Balancing as Balancing
from twin.procedures.fits import Fits as Fits
from twin.procedures.lab import Lab as Lab
from twin.procedures.logbook import Logbook as Logbook
from twin.procedures.notes import Notes as Notes
from twin.procedures.phases import Phase as Phase
from twin.procedures.plan import Aim as Aim
from twin.procedures.statement import Statement as Statement
