import stat
import zipfile

import pytest

from workers.readers.detect import open_recording
from workers.readers.recording import ReadError, legible


def test_letters_of_any_language_stay():
    assert legible("мой файл – 'ü' 走る: no clouds.") == "мой файл – 'ü' 走る: no clouds."


def test_control_characters_are_written_out_and_endless_words_cut():
    assert legible("a\nb\x1b[31m \udc80") == "a\\nb\\x1b[31m \\udc80"
    assert legible(f"{'n' * 5000} is cut") == f"{'n' * 300}... is cut"
    assert len(legible("word " * 10_000)) < 21_000
    once = legible(f"{'n' * 5000}\n")
    assert legible(once) == once


@pytest.mark.parametrize("name", ["a\nb\x1b[31m", "n" * 200 + "/" + "m" * 200, "/".join(["n" * 200] * 20)])
@pytest.mark.parametrize("mode", [stat.S_IFLNK, stat.S_IFREG])
def test_names_in_an_archive_cannot_deface_a_message(tmp_path, name, mode):
    member = zipfile.ZipInfo(f"{name}.txt")
    member.external_attr = (mode | 0o644) << 16
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr(member, "/etc/hosts")
    with pytest.raises(ReadError) as caught:
        open_recording(tmp_path / "walk.zip")
    assert caught.value.message.isprintable() and len(caught.value.message) < 1000
