"""Checks that a platform's two files agree, and with what MuJoCo compiles."""

from twin.check.finding import Finding as Finding
from twin.check.platform import check_platform as check_platform
