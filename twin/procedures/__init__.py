"""Balancing as a laboratory does it: phases, checks before each, a statement of the result."""

from twin.procedures.balancing import Balancing as Balancing
from twin.procedures.fits import Fits as Fits
from twin.procedures.logbook import Lab as Lab
from twin.procedures.logbook import Logbook as Logbook
from twin.procedures.plan import Aim as Aim
from twin.procedures.plan import Notes as Notes
from twin.procedures.plan import Phase as Phase
from twin.procedures.plan import Remark as Remark
from twin.procedures.plan import Statement as Statement
from twin.procedures.setup import WAYS as WAYS
from twin.procedures.setup import Refused as Refused
from twin.procedures.setup import Way as Way
from twin.procedures.setup import balancing as balancing
from twin.procedures.setup import random_offsets as random_offsets
from twin.procedures.setup import refuse as refuse
from twin.procedures.setup import usual_target as usual_target
