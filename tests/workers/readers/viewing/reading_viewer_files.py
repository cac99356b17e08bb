"""A viewer's file as other programs read it: by mcap, and by protobuf with the file's own descriptors."""

from __future__ import annotations

import cv2
import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation


def messages(path, *topics):
    """(channel, message's log time, decoded message), in the order of the times."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = reader.iter_decoded_messages(topics=list(topics) or None)
        return [(channel, message.log_time, decoded) for _, channel, message, decoded in found]


def stamp_ns(message):
    return message.timestamp.seconds * 1_000_000_000 + message.timestamp.nanos


def chain(transforms, to_frame, from_frame):
    """``T_to_from`` (R, t), by the poses of frames in their parents."""
    poses = {
        one.child_frame_id: (
            one.parent_frame_id,
            Rotation.from_quat([one.rotation.x, one.rotation.y, one.rotation.z, one.rotation.w]).as_matrix(),
            np.array([one.translation.x, one.translation.y, one.translation.z]),
        )
        for one in transforms
    }

    def to_root(frame):
        R, t = np.eye(3), np.zeros(3)
        while frame in poses:
            frame, R_up, t_up = poses[frame]
            R, t = R_up @ R, R_up @ t + t_up
        return frame, R, t

    (root, R_to, t_to), (same, R_from, t_from) = to_root(to_frame), to_root(from_frame)
    assert root == same
    return R_to.T @ R_from, R_to.T @ (t_from - t_to)


def distorted(calibration, points):
    """(N, 2) pixels of points in the camera's frame by K and D, as the schema's page says of its models."""
    K, D = np.array(calibration.K).reshape(3, 3), np.array(calibration.D)
    none = np.zeros(3)
    if calibration.distortion_model == "kannala_brandt":
        return cv2.fisheye.projectPoints(points[:, None], none, none, K, D)[0].reshape(-1, 2)
    assert (calibration.distortion_model, len(D)) in (("plumb_bob", 5), ("rational_polynomial", 8))
    return cv2.projectPoints(points, none, none, K, D)[0].reshape(-1, 2)


def rectified(calibration, points):
    """(N, 2) pixels by P and R, as viewers without distortion project."""
    P, R = np.array(calibration.P).reshape(3, 4), np.array(calibration.R).reshape(3, 3)
    projected = np.column_stack([points @ R.T, np.ones(len(points))]) @ P.T
    return projected[:, :2] / projected[:, 2:]
