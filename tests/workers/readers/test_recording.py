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


@pytest.mark.parametrize("name", ["a\nb\x1b[31m.png", "n" * 200 + "/" + "m" * 200 + ".png"])
def test_names_in_an_archive_cannot_deface_a_message(tmp_path, name):
    link = zipfile.ZipInfo(name)
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr(link, "/etc/hosts")
    with pytest.raises(ReadError, match="is a link") as caught:
        open_recording(tmp_path / "walk.zip")
    assert caught.value.message.isprintable() and len(caught.value.message) < 200


def test_names_of_files_that_are_not_read_cannot_either(tmp_path):
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr("a\nb\x1b[31m.txt", "nothing to read")
        archive.writestr("/".join(["n" * 200] * 20) + ".txt", "nothing to read")
    with pytest.raises(ReadError) as caught:
        open_recording(tmp_path / "walk.zip")
    assert caught.value.message.isprintable() and len(caught.value.message) < 1000
