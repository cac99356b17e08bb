"""Reading pairs: what is taken, and how what is not is named."""

import json
import time
import tracemalloc

import pytest

from service.pairs.pair_files import read_csv, read_json
from service.platform.http.problems import Problem

HEADER = "x,y,z,u,v"
MIB = 1024 * 1024


def refusal(text):
    with pytest.raises(Problem) as caught:
        read_csv(text)
    assert (caught.value.status, caught.value.code) == (422, "invalid_pairs")
    return caught.value.detail


def json_refusal(document):
    body = document if isinstance(document, bytes) else json.dumps(document).encode()
    with pytest.raises(Problem) as caught:
        read_json(body)
    assert caught.value.code == "invalid_pairs"
    return caught.value.detail


def test_columns_in_any_order_with_others_that_are_ignored():
    text = "pose,vertex,V,u, x ,y,z\r\n7,top,2.5,1.5,4,5,6\r\n\r\n10,left,3.5,2.5,7,8,9\r\n"
    assert read_csv("\ufeff" + text) == {
        "x": [4.0, 7.0], "y": [5.0, 8.0], "z": [6.0, 9.0], "u": [1.5, 2.5], "v": [2.5, 3.5], "group": [7, 10]
    }  # fmt: skip


def test_stamps_keep_every_nanosecond_and_groups_their_names():
    columns = read_csv(f"{HEADER},stamp_ns,group\n1,2,3,4,5,1732180000123456789,left\n1,2,3,4,5,-3,2\n")
    assert columns["stamp_ns"] == [1732180000123456789, -3]
    assert columns["group"] == ["left", "2"]


def test_a_vertexs_deviations_are_taken_where_all_are_given():
    columns = read_csv(f"{HEADER},sigma_range_m,sigma_azimuth_rad\n1,2,3,4,5,0.01,4e-4\n1,2,3,4,5,0.02,5e-4\n")
    assert (columns["sigma_range_m"], columns["sigma_azimuth_rad"]) == ([0.01, 0.02], [4e-4, 5e-4])
    assert "line 2, column sigma_range_m: '0' is not above 0" in refusal(f"{HEADER},sigma_range_m\n1,2,3,4,5,0\n")


def test_a_pair_may_say_its_corner():
    columns = read_csv(f"{HEADER},corner\n1,2,3,4,5,top\n1,2,3,4,5,bottom\n")
    assert columns["corner"] == ["top", "bottom"]
    rows = [dict(zip((*"xyzuv", "corner"), (1, 2, 3, 4, 5, name), strict=True)) for name in ("left", "right")]
    assert read_json(json.dumps({"pairs": rows}).encode())["corner"] == ["left", "right"]
    assert "no corner of the board; it has top, left, right, bottom" in refusal(f"{HEADER},corner\n1,2,3,4,5,Top\n")
    assert "member corner" in json_refusal({"pairs": [rows[0] | {"corner": ["top"]}]})


def test_the_column_group_wins_over_pose():
    assert read_csv("pose,x,y,z,u,v,group\n1,1,2,3,4,5,9\n")["group"] == [9]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1: the header lacks x, y, z, u, v; it has nothing"),
        ("x,y,z,u\n1,2,3,4\n", "line 1: the header lacks v"),
        ("x;y;z;u;v\n1;2;3;4;5\n", "lacks x, y, z, u, v, for the columns are separated by semicolons"),
        ("x\ty\tz\tu\tv\n1\t2\t3\t4\t5\n", "separated by tabs"),
        (f"{HEADER}\n1_0,2,3,4,5\n", "line 2, column x: '1_0' is no number"),
        (f"{HEADER}\n1,２,3,4,5\n", "line 2, column y: '２' is no number"),
        (f"{HEADER},stamp_ns\n1,2,3,4,5,１\n", "line 2, column stamp_ns: '１' is no integer"),
        (f"{HEADER},x\n1,2,3,4,5,6\n", "names x twice"),
        (f"{HEADER}\n", "no pairs"),
        (f"{HEADER}\n1,2,3,4,5\n1,2,3,4\n", "line 3 has 4 columns, the header 5"),
        (f"{HEADER}\n1,2,3,4,5\n1,2,three,4,5\n", "line 3, column z: 'three' is no number"),
        (f"{HEADER}\n1,2,,4,5\n", "line 2, column z: is missing"),
        (f"{HEADER}\n1,2,nan,4,5\n", "line 2, column z: 'nan' is not finite"),
        (f"{HEADER}\n1,2,3,4,1e10\n", "line 2, column v: '1e10' is too large"),
        (f"{HEADER},stamp_ns\n1,2,3,4,5,1.5\n", "line 2, column stamp_ns: '1.5' is no integer"),
        (f"{HEADER},stamp_ns\n1,2,3,4,5,9999999999999999999\n", "does not fit into 64 bits"),
        (f'{HEADER}\n1,2,3,4,"5\n', "line 2"),
        (f"{HEADER}\n1,2,3,4,{'5' * 200}\n", "..."),
    ],
)
def test_what_is_wrong_is_named_by_line_and_column(text, says):
    assert says in refusal(text)


def test_json_pairs():
    pair = {"x": 1, "y": 2.5, "z": 3, "u": 4, "v": 5, "stamp_ns": 12, "group": "a", "comment": "x"}
    assert read_json(json.dumps({"pairs": [pair]}).encode()) == {
        "x": [1.0], "y": [2.5], "z": [3.0], "u": [4.0], "v": [5.0], "stamp_ns": [12], "group": ["a"]
    }  # fmt: skip


@pytest.mark.parametrize(
    ("document", "says"),
    [
        (b"{", "no JSON"),
        (b"[" * 100_000, "no JSON"),
        ([], 'no list "pairs"'),
        ({"pairs": {}}, 'no list "pairs"'),
        ({"pairs": []}, "no pairs"),
        ({"pairs": [3]}, "pairs[0] is no object"),
        ({"pairs": [{"x": 1, "y": 2, "z": 3, "u": 4}]}, "pairs[0], member v: is missing"),
        ({"pairs": [{"x": 1, "y": 2, "z": 3, "u": 4, "v": True}]}, "pairs[0], member v: True is no number"),
        ({"pairs": [{"x": 1, "y": 2, "z": 3, "u": 4, "v": [1]}]}, "pairs[0], member v: [1] is no number"),
        (b'{"pairs": [{"x": 1, "y": 2, "z": 3, "u": 4, "v": NaN}]}', "not finite"),
        ({"pairs": [{"x": 1, "y": 2, "z": 3, "u": 4, "v": 10**400}]}, "no number"),
        ({"pairs": [{"x": 1, "y": 2, "z": 3, "u": 4, "v": 5, "stamp_ns": 1.0}]}, "no integer"),
        ({"pairs": [{"x": 1, "y": 2, "z": 3, "u": 4, "v": 5, "group": {}}]}, "neither a name nor an integer"),
    ],
)
def test_json_is_refused_by_pair_and_member(document, says):
    assert says in json_refusal(document)


def test_a_member_that_only_some_pairs_have_is_refused():
    first, second = {"x": 1, "y": 2, "z": 3, "u": 4, "v": 5}, {"x": 1, "y": 2, "z": 3, "u": 4, "v": 5, "group": 1}
    assert "pairs[1], member group: the pairs before it have none" in json_refusal({"pairs": [first, second]})
    assert "pairs[1], member group: is missing" in json_refusal({"pairs": [second, first]})


def test_a_mark_that_claims_to_be_a_thousandth_of_a_pixel_sharp_is_refused():
    with pytest.raises(Problem) as refused:
        read_csv("x,y,z,u,v,sigma_px\n5,0,1,100,100,0.5\n5,1,1,120,100,0.001\n")
    assert "would outweigh all others" in refused.value.detail


@pytest.mark.parametrize(
    "body",
    [
        b'{"pairs":[' + b'{"":[]},' * MIB + b"{}]}",
        b'{"pairs":[{"x":' + b'[{"":[]},' * MIB,
        b'{"pairs":[{"x":' + b"[" * 8 * MIB,
        b'{"pairs":[{"x":' + b"9" * 8 * MIB + b"}]}",
        b'{"a":[' + b'{"":[]},' * MIB + b'{}],"pairs":[]}',
        b'{"pairs":[{"x":[' + b"1," * 4 * MIB + b"1]}]}",
        b'{"pairs":[{"x":[' + b"1.23," * (8 * MIB // 5) + b"1]}]}",
    ],
    ids=["many", "in one", "deep", "a number", "in another member", "many numbers", "fewer numbers"],
)  # fmt: skip
def test_eight_hostile_megabytes_cost_little(body: bytes) -> None:
    began = time.process_time()
    with pytest.raises(Problem):
        read_json(body)
    assert time.process_time() - began < 1.0
    tracemalloc.start()  # which makes the same take ten times as long
    with pytest.raises(Problem):
        read_json(body)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100 * MIB, "as many objects as a hundred thousand pairs have"
