"""Checks that anyone can run: a platform's two files held against each other."""

from twin.check.finding import Finding as Finding
from twin.check.platform import check_platform as check_platform
