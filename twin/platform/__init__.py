"""What a machine is: its parts, and the TOML and MJCF pair that states them."""

from twin.platform.at_rest import begins_late as begins_late
from twin.platform.at_rest import beyond_stated as beyond_stated
from twin.platform.at_rest import taken_as_at_rest as taken_as_at_rest
from twin.platform.load import load_platform as load_platform
from twin.platform.load import variants_of as variants_of
from twin.platform.of_log import check_columns as check_columns
from twin.platform.of_log import common_platform as common_platform
from twin.platform.of_log import field_world as field_world
from twin.platform.of_log import floor_log as floor_log
from twin.platform.of_log import in_gravity_of as in_gravity_of
from twin.platform.of_log import in_order_of as in_order_of
from twin.platform.of_log import on_floor as on_floor
from twin.platform.of_log import other_machine as other_machine
from twin.platform.of_log import platform_of as platform_of
from twin.platform.of_log import platform_or_reason as platform_or_reason
from twin.platform.parts import Base as Base
from twin.platform.parts import Gas as Gas
from twin.platform.parts import Gimbal as Gimbal
from twin.platform.parts import PitchStop as PitchStop
from twin.platform.parts import Platform as Platform
from twin.platform.parts import Sensor as Sensor
from twin.platform.parts import Stage as Stage
from twin.platform.parts import StatedEffect as StatedEffect
from twin.platform.parts import Thruster as Thruster
from twin.platform.parts import Wheel as Wheel
from twin.platform.parts import files_of as files_of
