"""What a rig may do wrong, one sentence each for the person at the bench.

::

    RigError
    ├── PortError               a port cannot be opened
    │   ├── PortBusy            another program has it
    │   └── PortLost            it vanished while open
    ├── WriteTimeout            a write did not end in time; the device may have got all of it
    ├── NoAnswer                a device stayed silent past its deadline
    ├── WrongDevice             what answers is not the device, or not set up as needed
    ├── NotAtRest               after one of these the finger could not be taken off the object
    ├── SensorFault             the frames cannot be trusted
    │   ├── StaleSensor         none came for three periods
    │   ├── SensorOverload      a taxel is at the end of its range
    │   └── BaselineRefused     the finger seems to touch something, or the board calibrated under load
    └── StageFault              the stage cannot be trusted
        ├── CommandRefused      the controller answered `error:N`
        ├── StageAlarm          the controller stopped with `ALARM:N` and waits for an operator
        ├── PositionUnknown     nobody has homed it since the last reset
        └── OutOfLimits         the target lies outside the limits of the rig; nothing was sent

What is wrong in a file or an argument is an `InputError` instead. Neither pySerial's nor termios' exceptions leave
`port.py`.
"""


class RigError(Exception):
    """A device or its port failed; the message is one sentence that says what was expected, what came, and where."""


class PortError(RigError):
    """A port cannot be opened."""


class PortBusy(PortError):
    """Another program has the port open."""


class PortLost(PortError):
    """The port vanished while it was open, as when its plug is pulled."""


class WriteTimeout(RigError, TimeoutError):
    """A write did not end in time. The device may have got all of it, so nothing may be sent again blindly."""


class NoAnswer(RigError, TimeoutError):
    """A device stayed silent past its deadline."""


class WrongDevice(RigError):
    """What answers on the port is not the device expected, speaks at another speed, or is not set up as needed."""


class NotAtRest(RigError):
    """Something failed, and then the finger could not be taken off the object either; someone must do it by hand."""


class SensorFault(RigError):
    """The frames of the sensor cannot be trusted."""


class StaleSensor(SensorFault, TimeoutError):
    """No frame came for three periods; the last one is not repeated."""


class SensorOverload(SensorFault):
    """A taxel reached the end of its range under load."""


class BaselineRefused(SensorFault):
    """The readings without contact are not those of an untouched sensor."""


class StageFault(RigError):
    """The stage cannot be trusted to stand where it should."""


class CommandRefused(StageFault):
    """The controller refused a command.

    Attributes:
        code: Number of the error.
    """

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class StageAlarm(StageFault):
    """The controller stopped and accepts nothing until an operator homes or unlocks it.

    Attributes:
        code: Number of the alarm, or None where the controller reports only that it is locked.
    """

    def __init__(self, message: str, code: int | None = None) -> None:
        super().__init__(message)
        self.code = code


class PositionUnknown(StageFault):
    """The stage has not been homed since it was last reset."""


class OutOfLimits(StageFault):
    """A target lies outside the limits of the rig; nothing was sent."""
