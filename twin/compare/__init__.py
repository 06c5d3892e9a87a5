"""Comparison of a model with logs: misfits, the symptoms that explain them, free runs."""

from twin.compare.comparison import Comparison as Comparison
from twin.compare.comparison import Transfer as Transfer
from twin.compare.comparison import compare as compare
from twin.compare.comparison import log_name as log_name
from twin.compare.comparison import name_of as name_of
from twin.compare.comparison import transfer as transfer
