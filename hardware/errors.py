"""Errors of a rig; each message is one sentence for the operator.

::

    RigError
    ├── PortError               a port cannot be opened
    │   ├── PortBusy            another program has it open
    │   └── PortLost            it disappeared while open
    ├── WriteTimeout            a write timed out; the device may have received all of it
    ├── NoAnswer                a device stayed silent past its deadline
    ├── WrongDevice             not the expected device, or not configured as needed
    ├── NotAtRest               after another error the finger could not be lifted off the object
    ├── SensorFault             the frames cannot be trusted
    │   ├── StaleSensor         no frame for too long
    │   ├── SensorOverload      a taxel saturated
    │   └── BaselineRefused     the finger may be touching something, or the board calibrated under load
    └── StageFault              the stage cannot be trusted
        ├── CommandRefused      the controller answered `error:N`
        ├── StageAlarm          the controller stopped with `ALARM:N` and waits for an operator
        ├── PositionUnknown     not homed since the last reset
        └── OutOfLimits         the target is outside the limits of the rig; nothing was sent

Invalid files and arguments raise `InputError` instead. Exceptions of pySerial and termios do not leave `port.py`.
"""


class RigError(Exception):
    """A device or its port failed; the message states what was expected, what was received, and where."""


class PortError(RigError):
    """A port cannot be opened."""


class PortBusy(PortError):
    """Another program has the port open."""


class PortLost(PortError):
    """The port disappeared while open, as when it is unplugged."""


class WriteTimeout(RigError, TimeoutError):
    """A write timed out. The device may have received all of it, so do not resend blindly."""


class NoAnswer(RigError, TimeoutError):
    """A device stayed silent past its deadline."""


class WrongDevice(RigError):
    """The device on the port is not the expected one, uses another baud rate, or is not configured as needed."""


class NotAtRest(RigError):
    """After an error, the finger could not be lifted off the object; do it by hand."""


class SensorFault(RigError):
    """The frames of the sensor cannot be trusted."""


class StaleSensor(SensorFault, TimeoutError):
    """No frame for too long, see `SkinMonitor.stale_s`; the last one is not repeated."""


class SensorOverload(SensorFault):
    """A taxel saturated under load."""


class BaselineRefused(SensorFault):
    """The baseline is not that of an untouched sensor."""


class StageFault(RigError):
    """The position of the stage cannot be trusted."""


class CommandRefused(StageFault):
    """The controller refused a command.

    Attributes:
        code: Error number.
    """

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class StageAlarm(StageFault):
    """The controller stopped and accepts nothing until an operator homes or unlocks it.

    Attributes:
        code: Alarm number, or None if the controller only reports that it is locked.
    """

    def __init__(self, message: str, code: int | None = None) -> None:
        super().__init__(message)
        self.code = code


class PositionUnknown(StageFault):
    """The stage has not been homed since it was last reset."""


class OutOfLimits(StageFault):
    """The target is outside the limits of the rig; nothing was sent."""
