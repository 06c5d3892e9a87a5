"""Comparison of a model with logs: misfits, the symptoms that explain them, free runs."""

from twin.comparison.comparison import Comparison as Comparison
from twin.comparison.comparison import Transfer as Transfer
from twin.comparison.comparison import compare as compare
from twin.comparison.comparison import log_name as log_name
from twin.comparison.comparison import name_of as name_of
from twin.comparison.comparison import transfer as transfer
