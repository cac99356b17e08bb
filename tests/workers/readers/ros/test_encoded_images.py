"""Images of CompressedImage and its relatives that are mosaics or frames of video."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from formats import frames_of, read
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from making_recordings import START_NS, cloud, header, scene
from making_ros2 import TYPES as ROS2
from making_ros2 import as_cdr, write_mcap
from making_videos import HEIGHT, WIDTH, number_of, picture
from rosbags.typesys import get_types_from_msg

from workers.readers.recording import ReadError

FFMPEG = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
ROS2.register(
    get_types_from_msg(
        "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
        "bool is_bigendian\nuint8[] data\n",
        FFMPEG,
    )
)
COMPRESSED, CLOUD = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud2"
VIDEO = "foxglove.CompressedVideo"
COUNT = 6


def recording(path, kind, message_of):
    """An MCAP file of clouds and of messages of one camera."""
    clouds, every = [], []
    for i in range(COUNT):
        stamp = START_NS + i * 100_000_000
        clouds.append(("/points", CLOUD, stamp, cloud(stamp, scene(), types=ROS2)))
        every.append(("/front/image", kind, stamp + 1, message_of(i, stamp + 1)))
    of_ros = kind != VIDEO
    encoded = (
        as_cdr(every) if of_ros else [(*one[:2], "protobuf", one[2], one[3].SerializeToString()) for one in every]
    )
    return write_mcap(path / "walk.mcap", [*as_cdr(clouds), *encoded])


def compressed(form, data):
    return lambda i, stamp: ROS2.types[COMPRESSED](
        header(stamp, "front", ROS2), form, np.frombuffer(data(i), np.uint8)
    )


def packet(encoding, data):
    return lambda i, stamp: ROS2.types[FFMPEG](
        header(stamp, "front", ROS2), WIDTH, HEIGHT, encoding, i, int(i == 0), False, np.frombuffer(data(i), np.uint8)
    )


def foxglove_video(codec, data):
    def message(i, stamp):
        made = CompressedVideo(frame_id="front", data=data(i), format=codec)
        made.timestamp.FromNanoseconds(stamp)
        return made

    return message


MESSAGES = {COMPRESSED: compressed, FFMPEG: packet, VIDEO: foxglove_video}


def colours():
    """A smooth picture, BGR."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([40 + 2 * x, 200 - 3 * y, 60 + x + y], -1).clip(0, 255).astype(np.uint8)


def mosaic(pattern, levels=1):
    """What a sensor with that pattern of filters, from its first pixel on, measures of the picture."""
    pixels = colours().astype(np.uint16) * levels
    out = np.zeros((HEIGHT, WIDTH), np.uint16)
    for at, colour in enumerate(pattern):
        row, column = divmod(at, 2)
        out[row::2, column::2] = pixels[row::2, column::2, "bgr".index(colour)]
    return out if levels > 1 else out.astype(np.uint8)


def encoded(suffix, pixels):
    return cv2.imencode(suffix, pixels)[1].tobytes()


def shown(frame):
    return cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize(
    ("form", "pattern", "suffix"),
    [
        *((f"bayer_{p}8; png compressed bayer_{p}8", p, ".png") for p in ("rggb", "bggr", "gbrg", "grbg")),
        *(("bayer_grbg8; jpeg compressed bayer_grbg8", "grbg", ".jpg"), ("bayer_gbrg8;png", "gbrg", ".png")),
        *(
            ("BayerRG8; png compressed BayerRG8", "rggb", ".png"),
            ("bayer_rggb8; tiff compressed bayer_rggb8", "rggb", ".tif"),
        ),
    ],
)
def test_a_mosaic_becomes_colour(tmp_path, form, pattern, suffix):
    data = encoded(suffix, mosaic(pattern))
    frames = frames_of(read(recording(tmp_path, COMPRESSED, compressed(form, lambda i: data)))[1])
    assert len(frames) == COUNT and "demosaiced" in frames[0].transcoding
    pixels = shown(frames[0])
    assert pixels.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(pixels[4:-4, 4:-4].astype(int) - colours()[4:-4, 4:-4]).mean() < (8 if suffix == ".jpg" else 3)


def test_a_mosaic_of_16_bits_becomes_colour(tmp_path):
    data = encoded(".png", mosaic("rggb", 200))
    form = "bayer_rggb16; png compressed bayer_rggb16"
    frames = frames_of(read(recording(tmp_path, COMPRESSED, compressed(form, lambda i: data)))[1])
    pixels = shown(frames[0])[4:-4, 4:-4].reshape(-1, 3)
    assert all(np.corrcoef(pixels[:, i], colours()[4:-4, 4:-4].reshape(-1, 3)[:, i])[0, 1] > 0.99 for i in range(3))


@pytest.mark.parametrize(
    ("form", "pixels"),
    [
        ("bayer_rggb8; jpeg compressed bgr8", colours()),  # image_transport made it colour before
        ("bayer_rggb8; jpeg compressed mono8", mosaic("rggb")),
        ("mono8; jpeg compressed mono8", mosaic("rggb")),
        ("jpeg", colours()),
    ],
)
def test_what_is_no_mosaic_stays_byte_for_byte(tmp_path, form, pixels):
    data = encoded(".jpg", pixels)
    (frame, *_) = frames_of(read(recording(tmp_path, COMPRESSED, compressed(form, lambda i: data)))[1])
    assert frame.data == data and not frame.transcoding


def stream(codec):
    """One access unit for each picture."""
    context = av.CodecContext.create(codec, "w")
    context.width, context.height, context.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    context.framerate, context.time_base = Fraction(10), Fraction(1, 10)
    context.options = {"tune": "zerolatency", "crf": "12", "x265-params": "log-level=none:repeat-headers=1"}
    units = []
    for number in range(COUNT):
        frame = av.VideoFrame.from_ndarray(picture(number), format="rgb24")
        frame.pts = number
        units += [bytes(unit) for unit in context.encode(frame)]
    return units + [bytes(unit) for unit in context.encode(None)]


@pytest.fixture(scope="module")
def streams():
    return {"h264": stream("libx264"), "hevc": stream("libx265")}


@pytest.mark.parametrize(
    ("codec", "kind", "name"),
    [
        *(("h264", COMPRESSED, name) for name in ("h264", "H264", "rgb8; libx264 compressed", "", "jpeg")),
        *(("hevc", COMPRESSED, name) for name in ("h265", "hevc", "bgr8; h265", "")),
        *(("h264", FFMPEG, name) for name in ("libx264", "h264_nvenc", "h264;yuv420p;bgr8;bgr8")),
        *(("hevc", FFMPEG, name) for name in ("hevc_vaapi", "libx265", "hevc;nv12;rgb8;rgb8")),
        *(("h264", VIDEO, "h264"), ("hevc", VIDEO, "h265")),
    ],
)
def test_frames_of_video_are_decoded_whatever_message_holds_them(tmp_path, streams, codec, kind, name):
    units = streams[codec]
    assert len(units) == COUNT
    found, items, warnings = read(recording(tmp_path, kind, MESSAGES[kind](name, lambda i: units[i])))
    frames = frames_of(items)
    assert [number_of(shown(frame)[..., ::-1]) for frame in frames] == list(range(COUNT)) and warnings == []
    assert [frame.stamp_ns for frame in frames] == [START_NS + i * 100_000_000 + 1 for i in range(COUNT)]
    assert {(f.media_type, f.width, f.height, bool(f.transcoding)) for f in frames} == {
        ("image/jpeg", WIDTH, HEIGHT, True)
    }
    assert ("camera", "/front/image", "front", COUNT) in [
        (s.kind, s.name, s.frame_id, s.count) for s in found.sensors
    ]


@pytest.mark.parametrize(("kind", "name"), [(FFMPEG, "libtheora"), (VIDEO, "theora")])
def test_a_codec_that_is_not_read_is_named(tmp_path, kind, name):
    with pytest.raises(ReadError, match=f"'{name}', which is not read") as caught:
        read(recording(tmp_path, kind, MESSAGES[kind](name, lambda i: b"\x80theora")))
    assert caught.value.code == "video_unsupported"


def test_video_without_a_key_frame_is_refused(tmp_path, streams):
    late = [*streams["h264"][1:], streams["h264"][1]]
    with pytest.raises(
        ReadError, match=f"None of the {COUNT} messages of /front/image can be used.*key frame"
    ) as caught:
        read(recording(tmp_path, VIDEO, foxglove_video("h264", lambda i: late[i])))
    assert caught.value.code == "video_damaged"
