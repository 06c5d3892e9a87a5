"""A model held against logs: what it misses, how that looks, and what would explain it."""

from twin.compare.comparison import Comparison as Comparison
from twin.compare.comparison import Transfer as Transfer
from twin.compare.comparison import compare as compare
from twin.compare.comparison import log_name as log_name
from twin.compare.comparison import name_of as name_of
from twin.compare.comparison import transfer as transfer
