"""Template folders for a new machine: they pass the check, fly and open in a viewer."""

from twin.scaffold.new import KINDS as KINDS
from twin.scaffold.new import new_platform as new_platform
