"""Objects of the drives' dictionaries that the master uses (docs/reference/drive-objects.md)."""

from __future__ import annotations

from drivers.can.drive_object import OUT_OF_RANGE, WRONG_STATE, DriveObject

DEVICE_TYPE = DriveObject(0x1000, 0, "<I", "device type")
ERROR_REGISTER = DriveObject(0x1001, 0, "<B", "error register")
ERROR_HISTORY_COUNT = DriveObject(0x1003, 0, "<B", "number of errors")
HEARTBEAT_CONSUMER = DriveObject(0x1016, 1, "<I", "consumer heartbeat time")
HEARTBEAT_PRODUCER = DriveObject(0x1017, 0, "<H", "producer heartbeat time")
VENDOR = DriveObject(0x1018, 1, "<I", "vendor")
PRODUCT = DriveObject(0x1018, 2, "<I", "product code")
REVISION = DriveObject(0x1018, 3, "<I", "revision")
SERIAL = DriveObject(0x1018, 4, "<I", "serial number")
ABORT_CONNECTION_OPTION = DriveObject(0x6007, 0, "<h", "abort connection option code")
ERROR_CODE = DriveObject(0x603F, 0, "<H", "error code")
STATUSWORD = DriveObject(0x6041, 0, "<H", "statusword")
MODE = DriveObject(0x6060, 0, "<b", "mode of operation")
MODE_DISPLAY = DriveObject(0x6061, 0, "<b", "mode of operation display")
POSITION_ACTUAL = DriveObject(0x6064, 0, "<i", "position actual")
RATED_TORQUE = DriveObject(0x6076, 0, "<I", "rated torque")
TARGET_POSITION = DriveObject(
    0x607A,
    0,
    "<i",
    "target position",
    refusals={
        OUT_OF_RANGE: (
            "the set-point is outside the software limits or the active table's grid",
            "choose a position inside both",
        ),
        WRONG_STATE: (
            "compensation is on but no valid table is active for this payload",
            "write and activate the payload's table, or switch compensation off",
        ),
    },
)
HOME_OFFSET = DriveObject(0x607C, 0, "<i", "home offset")
LIMIT_LOW = DriveObject(0x607D, 1, "<i", "software position limit, low")
LIMIT_HIGH = DriveObject(0x607D, 2, "<i", "software position limit, high")
PROFILE_VELOCITY = DriveObject(0x6081, 0, "<I", "profile velocity")
PROFILE_ACCELERATION = DriveObject(0x6083, 0, "<I", "profile acceleration")
QUICK_STOP_DECELERATION = DriveObject(0x6085, 0, "<I", "quick stop deceleration")
MAX_TORQUE = DriveObject(0x6072, 0, "<H", "max torque")
PROFILE_DECELERATION = DriveObject(0x6084, 0, "<I", "profile deceleration")
ENCODER_INCREMENTS = DriveObject(0x608F, 1, "<I", "encoder increments")
ENCODER_REVOLUTIONS = DriveObject(0x608F, 2, "<I", "motor revolutions of the encoder resolution")
GEAR_MOTOR = DriveObject(0x6091, 1, "<I", "motor revolutions of the gear")
GEAR_SHAFT = DriveObject(0x6091, 2, "<I", "shaft revolutions of the gear")
FEED = DriveObject(0x6092, 1, "<I", "feed")
FEED_REVOLUTIONS = DriveObject(0x6092, 2, "<I", "shaft revolutions of the feed")
INTERPOLATION_UNITS = DriveObject(0x60C2, 1, "<B", "interpolation time period")
INTERPOLATION_EXPONENT = DriveObject(0x60C2, 2, "<b", "interpolation time index")
HOMING_METHOD = DriveObject(0x6098, 0, "<b", "homing method")
HOMING_SPEED_SWITCH = DriveObject(0x6099, 1, "<I", "homing speed, search for the switch")
HOMING_SPEED_ZERO = DriveObject(0x6099, 2, "<I", "homing speed, search for zero")
HOMING_ACCELERATION = DriveObject(0x609A, 0, "<I", "homing acceleration")
