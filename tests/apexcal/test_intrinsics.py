"""Lenses out of the files that ROS and Kalibr write."""

import pytest

from apexcal.commands.camera_files import camera_and_file
from apexcal.errors import ClientError
from apexcal.intrinsics import read_intrinsics

K = [500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0]
LENS = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "K": K, "D": [0.1, -0.2, 0.001, 0.002, 0.0]}

CAMERA_CALIBRATION = f"""
image_width: 640
image_height: 480
camera_name: front
camera_matrix: {{rows: 3, cols: 3, data: {K}}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [0.1, -0.2, 0.001, 0.002, 0]}}
"""
CAMERA_INFO = f"""
header: {{frame_id: camera}}
height: 480
width: 640
distortion_model: plumb_bob
d: [0.1, -0.2, 0.001, 0.002, 0.0]
k: {K}
---
"""
CAMERA_INFO_1 = CAMERA_INFO.replace("\nd:", "\nD:").replace("\nk:", "\nK:")
OPENCV = f"""%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: {K}
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, -2e-1, 0.001, 0.002,
       0. ]
avg_reprojection_error: 3.9e-01
"""
CAMCHAIN = """
cam0:
  camera_model: pinhole
  intrinsics: [500.0, 510.0, 320.0, 240.0]
  distortion_model: equidistant
  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]
  resolution: [640, 480]
  rostopic: /rig/front/image_raw
cam1:
  camera_model: omni
  intrinsics: [1.0, 500.0, 510.0, 320.0, 240.0]
  rostopic: /rig/left/image_raw
"""


def read(tmp_path, text, camera="front"):
    path = tmp_path / "lens.yaml"
    path.write_text(text)
    return read_intrinsics(path, camera)


@pytest.mark.parametrize(
    "text", [OPENCV, CAMERA_CALIBRATION, CAMERA_INFO, CAMERA_INFO.replace(" d:", " D:").replace("k:", "K:")]
)
def test_what_ros_writes(tmp_path, text):
    assert read(tmp_path, text) == LENS


@pytest.mark.parametrize("camera", ["front", "cam0"])
def test_a_camchain_by_topic_or_name(tmp_path, camera):
    found = read(tmp_path, CAMCHAIN, camera)
    assert found == LENS | {"distortion_model": "equidistant", "D": [0.1, 0.2, 0.3, 0.4]}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (CAMCHAIN.replace("front", "left"), "'omni' has no equal here"),
        (CAMCHAIN.replace("front", "rear"), "has the cameras cam0, cam1, and none of them is clearly front"),
        (CAMCHAIN.replace("distortion_coeffs", "coeffs"), "no complete camera"),
        ("image_width: 640", "holds no intrinsics of a camera"),
        ("[1, 2]", "holds no intrinsics of a camera"),
        ("", "holds no intrinsics of a camera"),
        (CAMERA_INFO.replace("640", "wide"), "holds no intrinsics of a camera"),
        ("a: [", "is no YAML"),
        ("!!python/object/apply:os.system ['true']", "is no YAML"),
        ("x" * 1_000_001, "is too large"),
        (CAMERA_INFO.replace("500.0", ".nan"), "k holds nan"),
        (CAMCHAIN.replace("0.4", "-.inf"), "distortion_coeffs holds -inf"),
        (CAMERA_INFO.replace("640", ".inf"), "holds no intrinsics of a camera"),
    ],
)
def test_what_is_no_lens_is_refused_by_the_files_name(tmp_path, text, says):
    if "'omni'" in says:
        text = text.replace("/rig/left/image_raw\ncam1", "/rig/other/image_raw\ncam1").replace("left", "front")
    with pytest.raises(ClientError) as refused:
        read(tmp_path, text)
    assert "lens.yaml" in str(refused.value) and says in str(refused.value)


def test_opencv_s_fisheye(tmp_path):
    text = OPENCV.replace("image_width", "fisheye_model: 1\nimage_width")
    assert read(tmp_path, text)["distortion_model"] == "equidistant"


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ClientError, match=r"cannot read .*lens.yaml: no such file"):
        read_intrinsics(tmp_path / "lens.yaml", "front")


def test_a_camera_before_its_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert [str(part) for part in camera_and_file("front=a.csv")] == ["front", "a.csv"]
    assert [str(part) for part in camera_and_file("a.csv")] == ["", "a.csv"]
    (tmp_path / "a=b.csv").touch()
    assert [str(part) for part in camera_and_file("a=b.csv")] == ["", "a=b.csv"]
