"""Message definitions that the normalised files carry, as ROS 2 (common_interfaces) publishes them."""

from typing import Final

_SEPARATOR: Final = "=" * 80 + "\n"
_HEADER: Final = (
    _SEPARATOR + "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    "" + _SEPARATOR + "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)

POINT_CLOUD2: Final = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\n"
    "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n"
    + _HEADER
    + _SEPARATOR
    + "MSG: sensor_msgs/PointField\nuint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\n"
    "uint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n"
)

COMPRESSED_IMAGE: Final = "std_msgs/Header header\nstring format\nuint8[] data\n" + _HEADER
