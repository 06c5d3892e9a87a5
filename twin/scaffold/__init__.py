"""Folders to begin a lab's own machine with: they check, fly and open in a viewer at once."""

from twin.scaffold.new import KINDS as KINDS
from twin.scaffold.new import new_platform as new_platform
