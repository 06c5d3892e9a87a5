"""What a control law is, how one is loaded, and a check that any author can run."""

from twin.controller.check import check_controller as check_controller
from twin.controller.check import usual_machine as usual_machine
from twin.controller.controller import AnyController as AnyController
from twin.controller.controller import Controller as Controller
from twin.controller.load import load_controller as load_controller
from twin.controller.open_loop import OpenLoop as OpenLoop
