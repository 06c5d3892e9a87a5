"""What a stream says of its own noise: white, quantised, slow, its clock, its outliers."""

from twin.noise.finding import NoiseFinding as NoiseFinding
from twin.noise.finding import noise_findings as noise_findings
from twin.noise.stream import SampleClock as SampleClock
from twin.noise.stream import SlowNoise as SlowNoise
from twin.noise.stream import StreamNoise as StreamNoise
from twin.noise.stream import measure_noise as measure_noise
from twin.noise.stream import noise_and_worth as noise_and_worth
from twin.noise.stream import noise_left as noise_left
from twin.noise.stream import noise_of as noise_of
from twin.noise.stream import resolution_of as resolution_of
