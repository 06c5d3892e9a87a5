"""Our own link to a microcontroller: frames, messages, schema; no input or output here."""

from twin.plant.devices.link.frame import Frame as Frame
from twin.plant.devices.link.frame import Parser as Parser
from twin.plant.devices.link.frame import ParserCounters as ParserCounters
from twin.plant.devices.link.frame import checksum as checksum
from twin.plant.devices.link.frame import packed as packed
from twin.plant.devices.link.messages import EVENTS as EVENTS
from twin.plant.devices.link.messages import LONGEST_PAYLOAD as LONGEST_PAYLOAD
from twin.plant.devices.link.messages import MESSAGES as MESSAGES
from twin.plant.devices.link.messages import FarEndState as FarEndState
from twin.plant.devices.link.messages import Flag as Flag
from twin.plant.devices.link.messages import MessageType as MessageType
from twin.plant.devices.link.messages import sentence_of as sentence_of
from twin.plant.devices.link.payloads import ArmRequest as ArmRequest
from twin.plant.devices.link.payloads import Event as Event
from twin.plant.devices.link.payloads import Hello as Hello
from twin.plant.devices.link.payloads import SampleRows as SampleRows
from twin.plant.devices.link.payloads import SetPoint as SetPoint
from twin.plant.devices.link.payloads import TimeSync as TimeSync
from twin.plant.devices.link.payloads import rows_in_a_frame as rows_in_a_frame
from twin.plant.devices.link.schema import Channel as Channel
from twin.plant.devices.link.schema import Schema as Schema
