"""A session with an MTi inertial unit (Xsens, Movella), over its Xbus messages."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from twin.errors import DeviceError, UnknownName, UsageError
from twin.plant.devices.device import DeviceSettings, Sample, StreamLimits
from twin.plant.devices.port import Port
from twin.plant.devices.sensor import SensorSession
from twin.plant.devices.xbus import (
    BAUD_CODES,
    CHANNELS,
    ERRORS,
    MAXIMUM_RATE,
    PACKET_COUNTER,
    PRECISIONS,
    SAMPLE_TIME_FINE,
    DeviceClock,
    FrameParser,
    MessageId,
    OutputSetting,
    Promptest,
    Wrapping,
    XbusMessage,
    decode_data,
    decode_outputs,
    encode,
    encode_outputs,
    packet_bytes,
)
from twin.units import STANDARD_GRAVITY

_ANSWER = 0.1
"""How long an answer may take [s]: several times what was seen."""
_TRIES = 30
"""Of GoToConfig; data in flight delay its answer, and a device that boots needs a second."""
_QUIET = 0.05
"""So long without a byte [s], an unfinished frame stays unfinished."""
_LONGEST = 254
"""Bytes of data in any message of a configuration that the settings can ask for."""
_LEAP = 1.0
"""A larger step of the device's clock [s], beyond the packets that are missing, is no step."""
_SLIP = 0.003
"""By so much the step between two stamps may be off before the clock counts as stepped [s]."""
_LOST = 1000
"""More missing packets than that are a corrupt counter."""
_FROM_CELSIUS = 273.15


@dataclass(frozen=True, kw_only=True)
class MtiSettings(DeviceSettings):
    """An MTi on a serial port."""

    baud: int = 115200
    stop_bits: int = 2
    """Sent; one is accepted. Sources differ on whether the device sends one or two."""
    rates: Mapping[str, int] = field(default_factory=lambda: {"gyro": 100, "accelerometer": 100})
    """Stream -> rate [Hz]."""
    precision: str = "float32"
    """Number format on the line: float32, fp12.20, fp16.32 or float64."""
    device_id: int | None = None
    """Of the one unit that is meant; None: any."""
    magnetic_unit: float | None = None
    """Tesla of one arbitrary unit: the field's strength where the device was calibrated."""
    full_scale_rate: float = math.radians(2000.0)
    """Of the gyro [rad/s], MTi-1; from there on a value is not valid."""
    full_scale_acceleration: float = 16.0 * STANDARD_GRAVITY
    """[m/s^2], MTi-1."""
    clock_span: int = 1 << 32
    """Ticks after which the device's clock wraps: 2^32 on MTi-1 and 600, 864 million on 10 and
    100."""
    frozen_after: int = 20
    """So many equal values in a row mean that the sensor has stopped; 0: never."""
    largest_steps: Mapping[str, float] = field(default_factory=dict[str, float])
    """Stream -> largest change between two samples [SI] that the machine can make."""
    silence: float = 0.25
    """So long without a sample [s] is said to be silence."""

    def __post_init__(self) -> None:
        """Hold the parts against each other.

        Raises:
            UnknownName: a stream or a number format that it has not.
            UsageError: a rate, a baud rate, or a line that cannot carry it.
        """
        for stream in (*self.rates, *self.largest_steps):
            if stream not in CHANNELS:
                raise UnknownName("stream of an MTi", stream, CHANNELS)
        for stream, rate in self.rates.items():
            if not 0 < rate < MAXIMUM_RATE:
                raise UsageError(f"{self.name}: {stream} at {rate} Hz; give 1 to 65534 Hz")
        if self.precision not in PRECISIONS:
            raise UnknownName("number format", self.precision, PRECISIONS)
        if self.baud not in BAUD_CODES:
            known = ", ".join(map(str, BAUD_CODES))
            raise UsageError(f"{self.name}: {self.baud} baud; an MTi has {known}")
        if "magnetometer" in self.rates and self.magnetic_unit is None:
            raise UsageError(
                f"{self.name}: the magnetometer counts in the field where it was calibrated; "
                "give that field's strength as magnetic_unit, in tesla"
            )
        if self.load() > 0.95:
            raise UsageError(
                f"{self.name}: these rates need {100 * self.load():.0f} % of a line of "
                f"{self.baud} baud; lower them, or raise the baud rate"
            )

    def session(self) -> "Mti":
        """A session with this device, not yet connected."""
        return Mti(self)

    def limits(self) -> dict[str, StreamLimits]:
        """Full scales of its sensors; a checksum of eight bits lets one message in 256 through."""
        full_scale = {
            "gyro": self.full_scale_rate,
            "accelerometer": self.full_scale_acceleration,
            # the field in a coil cage is a few times the earth's
            "magnetometer": 20.0 * (self.magnetic_unit or 1.0),
            "attitude": 1.01,
            "temperature": 500.0,
        }
        return {
            name: StreamLimits(
                range=full_scale[name],
                largest_step=self.largest_steps.get(name, math.inf),
                frozen_after=0 if name == "temperature" else self.frozen_after,
                first_confirmed=name in self.largest_steps,
            )
            for name in self.rates
        }

    def outputs(self) -> list[OutputSetting]:
        """The output configuration that these settings ask for."""
        code = PRECISIONS[self.precision]
        asked = [
            OutputSetting(PACKET_COUNTER, MAXIMUM_RATE),
            OutputSetting(SAMPLE_TIME_FINE, MAXIMUM_RATE),
        ]
        asked += [
            OutputSetting(CHANNELS[name].kind | code, rate) for name, rate in self.rates.items()
        ]
        return asked

    def load(self) -> float:
        """Share of the line that the messages need, all items in one message each time."""
        if not self.rates:
            return 0.0
        bits = 10 * packet_bytes(self.outputs()) * max(self.rates.values())
        return bits / self.baud


class Mti(SensorSession):
    """An MTi that measures."""

    def __init__(self, settings: MtiSettings) -> None:
        super().__init__(
            settings.name,
            settings.port,
            baud=settings.baud,
            stop_bits=settings.stop_bits,
            streams={name: CHANNELS[name].width for name in settings.rates},
            silence=settings.silence,
        )
        self._settings = settings
        self._parser = FrameParser(self.counters, _LONGEST)
        self._packets = Wrapping(1 << 16)
        self._clock = DeviceClock(settings.clock_span)
        self._promptest = Promptest()
        self._streams = {CHANNELS[name].kind: name for name in settings.rates}
        self._refused = 0
        """Error and warning messages since the last request: their code, else 0."""
        self.device_id = 0

    def _greet(self, port: Port) -> None:
        self._parser = FrameParser(self.counters, _LONGEST)
        self._request(port, MessageId.GO_TO_CONFIG, tries=_TRIES)
        answer = self._request(port, MessageId.REQUEST_DEVICE_ID)
        self.device_id = int.from_bytes(answer, "big")
        self.identity = f"unit {self.device_id:08X}"
        wanted = self._settings.device_id
        if wanted is not None and wanted != self.device_id:
            raise DeviceError(
                self.name,
                f"the device on {port.url} is {self.device_id:08X}, not {wanted:08X}",
                "check which port is whose",
            )

    def _set_up(self, port: Port) -> None:
        settings = self._settings.outputs()
        self._request(port, MessageId.GO_TO_CONFIG, tries=_TRIES)
        answer = self._request(port, MessageId.SET_OUTPUT_CONFIGURATION, encode_outputs(settings))
        effective = {each.identifier: each.rate for each in decode_outputs(answer) or ()}
        for each in settings:
            name = self._streams.get(each.identifier & ~0xF, f"item {each.identifier:04X}")
            if each.identifier not in effective:
                raise DeviceError(
                    self.name,
                    f"does not give {name} (data {each.identifier:04X})",
                    "take it out of the rates, or use a model that has it",
                )
            rate = effective[each.identifier]
            # of counters and times the device may report any rate: they come with every packet
            if name in self.streams and rate != each.rate:
                raise DeviceError(
                    self.name,
                    f"gives {name} at {rate} Hz, not at {each.rate} Hz",
                    f"ask for {rate} Hz",
                )
        self._packets.forget()
        self._clock.forget()
        self._promptest.forget()
        self._request(port, MessageId.GO_TO_MEASUREMENT)

    def _request(self, port: Port, what: MessageId, data: bytes = b"", *, tries: int = 5) -> bytes:
        """Data of the acknowledgement; measurements on the way are thrown away.

        Raises:
            DeviceError: no acknowledgement, or an error message instead.
        """
        arrived = 0
        self._refused = 0
        for _ in range(tries):
            port.write(encode(XbusMessage(what, data)))
            deadline = time.monotonic() + _ANSWER
            while time.monotonic() < deadline:
                received = port.read(_ANSWER / 4)
                arrived += len(received)
                for message in self._parser.feed(received) if received else self._parser.idle():
                    if message.identifier == what + 1:
                        return message.data
                    self._aside(port, message)
            self.counters.timeouts += 1
        waited = tries * _ANSWER
        if self._refused:
            problem = f"refuses {what.name}: {_complaint(self._refused)}"
            raise DeviceError(self.name, problem, "change the settings")
        guess = (
            f"is it powered and wired to {port.url}?"
            if not arrived
            else f"does it talk at {self._settings.baud} baud?"
        )
        problem = f"no answer to {what.name} in {waited:.1f} s, {arrived} bytes arrived"
        raise DeviceError(self.name, problem, guess)

    def _aside(self, port: Port, message: XbusMessage) -> None:
        """Whatever comes between a request and its answer."""
        if message.identifier == MessageId.WAKE_UP:
            port.write(encode(XbusMessage(MessageId.WAKE_UP_ACKNOWLEDGE)))
        elif message.identifier in (MessageId.ERROR, MessageId.WARNING) and message.data:
            self._refused = message.data[0]

    def _listen(self, port: Port) -> None:
        received = port.read(_QUIET)
        host_time = time.monotonic()
        for message in self._parser.feed(received) if received else self._parser.idle():
            if message.identifier == MessageId.DATA:
                self._measured(message, host_time, port.byte_time)
            elif message.identifier == MessageId.WAKE_UP:
                self.notes.append(f"{self.name}: restarted by itself, and was configured again")
                port.write(encode(XbusMessage(MessageId.WAKE_UP_ACKNOWLEDGE)))
                self._set_up(port)
                return
            elif message.identifier in (MessageId.ERROR, MessageId.WARNING) and message.data:
                self.notes.append(f"{self.name}: reports {_complaint(message.data[0])}")

    def _measured(self, message: XbusMessage, host_time: float, byte_time: float) -> None:
        items = decode_data(message.data)
        if items is None:
            # it passed the checksum by chance
            self.counters.bad_checksums += 1
            return
        values = {item.kind: item.values for item in items}
        doubt, missed = "", 0
        if PACKET_COUNTER in values:
            step = self._packets.step(int(values[PACKET_COUNTER][0]))
            if step == 0:
                return  # the same packet twice
            if step is not None and 0 < step <= _LOST:
                missed = step - 1
                self.counters.gaps += missed
            elif step is not None:
                doubt = f"the packet counter leapt by {step}"
        latency = (len(message.data) + 5) * byte_time
        device_time = None
        if SAMPLE_TIME_FINE in values:
            device_time, step = self._clock.read(int(values[SAMPLE_TIME_FINE][0]))
            if abs(step) > _LEAP + missed / min(self._settings.rates.values()):
                doubt = doubt or f"the device's clock leapt by {step:.1f} s"
            if abs(step - (1 + missed) / max(self._settings.rates.values())) > _SLIP:
                self._promptest.forget()
            if not doubt:
                host_time = self._promptest.host(device_time, host_time - latency) + latency
        for kind, name in self._streams.items():
            if kind not in values:
                continue
            value = self._in_si(name, values[kind])
            self._keep(
                Sample(
                    name,
                    value,
                    host_time,
                    latency=latency,
                    device_time=device_time,
                    valid=not doubt,
                    reason=f"{self.name}: {name} {doubt}" if doubt else "",
                )
            )

    def _in_si(self, name: str, value: tuple[float, ...]) -> tuple[float, ...]:
        if name == "temperature":
            return (value[0] + _FROM_CELSIUS,)
        if name == "magnetometer":
            unit = self._settings.magnetic_unit or float("nan")
            return tuple(unit * each for each in value)
        return value


def _complaint(code: int) -> str:
    return ERRORS.get(code, "an error") + f" (code {code:02X})"
