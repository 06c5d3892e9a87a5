"""Why reality departs from a machine's model: one cause per file, and the catalogue."""

from twin.effects.catalogue import catalogue as catalogue
from twin.effects.catalogue import effect_named as effect_named
from twin.effects.catalogue import effect_names as effect_names
from twin.effects.catalogue import file_of as file_of
from twin.effects.effect import Domain as Domain
from twin.effects.effect import Effect as Effect
from twin.effects.effect import EffectError as EffectError
from twin.effects.effect import Parameter as Parameter
from twin.effects.effect import parameter as parameter
from twin.effects.on_body import BodyEffect as BodyEffect
from twin.effects.on_body import CoupleEffect as CoupleEffect
from twin.effects.on_body import HingeSpring as HingeSpring
from twin.effects.on_body import Push as Push
from twin.effects.on_body import State as State
from twin.effects.on_sensor import SensorLaw as SensorLaw
from twin.effects.on_series import BiasEffect as BiasEffect
from twin.effects.on_series import Order as Order
from twin.effects.on_series import ReadingEffect as ReadingEffect
from twin.effects.on_series import ScatterEffect as ScatterEffect
from twin.effects.on_series import SeriesEffect as SeriesEffect
from twin.effects.on_series import VibrationEffect as VibrationEffect
from twin.effects.on_series import series_effects as series_effects
from twin.effects.stated import able as able
from twin.effects.stated import effects_of as effects_of
from twin.effects.stated import parse_effects as parse_effects
from twin.effects.stated import with_effects as with_effects
