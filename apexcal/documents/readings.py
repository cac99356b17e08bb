"""An owner's statements about a recording that its file lacks: options and their words.

Images are raw, as the lens drew them, or rectified: without distortion, and perhaps turned.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from apexcal.documents.base import Name, Received, Topic

FrameOrigin = Literal["tf_static", "robot_description"]
ImageKind = Literal["raw", "rectified"]
LidarModel = Literal["vlp16", "vlp32c", "hdl32e", "hdl64e", "alpha_prime"]
PointTimes = Literal["auto", "stamp_only"]
StampConvention = Literal["start", "end", "unknown"]


class Topics(Received):
    """Which topic, folder or file of this recording is the LiDAR and which is each camera, by its name in the rig.

    They take precedence over the rig's topics. A sensor that is not named keeps the rig's topic, or is found.
    """

    lidar: Topic | None = None
    cameras: Annotated[dict[Name, Topic], Field(default_factory=dict, max_length=64)]


class ReadOptions(Received):
    """The options of a reading: the members of a :class:`Reading` besides its topics."""

    point_times: PointTimes = "auto"
    stamp_convention: StampConvention | None = None
    rate_hz: Annotated[float, Field(ge=0.5, le=1000)] | None = None
    lidar_model: LidarModel | None = None
    rings: Annotated[int, Field(ge=1, le=256)] | None = None
    camera_start_ns: Annotated[int, Field(ge=0, lt=2**31 * 10**9)] | None = None
    accept_implausible: bool = False


class Reading(ReadOptions):
    """The owner's statements about a recording, for what its file does not say.

    ``topics`` says which is which; ``point_times: stamp_only`` leaves the points' own times out, as for still poses
    whose stamps were made up, ``auto`` uses them, or derives them where the file has none; ``stamp_convention`` says
    what a sweep's stamp means; ``rate_hz`` how often the LiDAR turns in a second; ``lidar_model`` which sensor sent
    captured packets; ``rings`` how many rings to compute where the file has none, 1 if the sensor has none;
    ``camera_start_ns`` when a video's first frame was taken, UTC nanoseconds, where nothing else says it;
    ``accept_implausible`` that the points are right although no LiDAR seems to have measured them.
    """

    topics: Topics = Topics(cameras={})
