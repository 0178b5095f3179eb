"""Disks that are full and files that are gone: what becomes of the files of before."""

import errno
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pytest

from long_work import (
    FEW,
    broken,
    errors,
    failing,
    files,
    full_disk,
    is_sentence,
    part,
    product,
    refusal,
    run,
    settle,
    state,
    whole,
)
from small_rigs import pixels


def test_a_full_disk_leaves_the_file_of_before(rig, tmp_path):
    """Export is refused in one sentence at whatever byte the disk is full.

    No part of a file is left.
    """
    for form in ("PNG8", "PNG16", "TIFF16", "EXR_HALF", "EXR_FLOAT"):
        bpy.context.scene.kiriko.export_format = form
        run("export")()
        before = files()
        name = part("core.files.image_io").named_for("source", form).name
        size = len(before[name])
        for room in (0, 100, size // 2, size - 13):
            with full_disk(room):
                assert "check the disk" in refusal(run("export"))
            assert files() == before, (form, room)
        with full_disk(size):
            assert run("export")() == {"FINISHED"}
        assert {name: len(content) for name, content in files().items()} == {
            k: len(v) for k, v in before.items()
        }


def test_what_the_system_refuses_leaves_the_files_of_before(rig, monkeypatch):
    """A file that cannot be made, filled or renamed: all are as before, in a report all of them."""
    before = files()
    full = OSError(errno.ENOSPC, "No space left on device")
    calls = ((part("core.files.disk"), "_temporary"), (Path, "replace"), (Path, "write_text"))
    for (owner, call), name in zip(
        (*calls[:2], *calls[1:]), ("export", "export", "report", "report"), strict=True
    ):
        with monkeypatch.context() as patch:
            patch.setattr(owner, call, failing(full))
            assert "No space left on device" in refusal(run(name))
        assert files() == before


def test_a_preview_that_the_disk_cuts_off_changes_nothing(rig, tmp_path, monkeypatch):
    """At whatever byte the temporary disk is full, one sentence says where to make room.

    A map is refused, too.
    """
    module = part("core.blender.preview.cycles_preview")
    sizes = []
    reading = part("operators.work").read(bpy.context)
    close = module.Preview.close

    with monkeypatch.context() as spied:
        spied.setattr(
            module.Preview,
            "close",
            lambda self: [sizes.append(self.path.stat().st_size), close(self)],
        )
        assert bpy.ops.kiriko.preview(samples=1) == {"FINISHED"}
        module.render_map(bpy.context.scene, reading)

    kept = pixels(bpy.context.scene.kiriko.result.preview).copy()
    before = state()
    size = min(sizes)

    # the times in it make it some bytes longer or shorter
    for room in (0, 100, 300, 500, 2000, size // 2, size - 40):
        with full_disk(room):
            text = refusal(lambda: bpy.ops.kiriko.preview(samples=1))
            with pytest.raises(part("core.base.errors").ImageError, match="disk space") as caught:
                module.render_map(bpy.context.scene, reading)
        assert "disk space" in text
        assert f"'{tempfile.gettempdir()}'" in text
        assert is_sentence(str(caught.value))
        assert state() == before, room
        assert np.array_equal(pixels(bpy.context.scene.kiriko.result.preview), kept)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", failing(OSError(errno.ENOSPC, "No space left on device")))
        path = tmp_path / "report" / "preview.png"
        text = refusal(lambda: bpy.ops.kiriko.preview(samples=1, filepath=str(path)))

    assert f"'{path}' cannot be written (No space left on device)" in text
    assert state() == before


def test_a_report_is_written_whole_or_not_at_all(rig, monkeypatch):
    """Where the disk is full in its midst, the earlier one is still there.

    The ladder is the earlier one, too.
    """
    assert run("report")() == {"FINISHED"}
    before = state()
    calls = []
    write = Path.write_text

    def fill(path: Path, *text: str, **how: str) -> int:
        calls.append(path)
        if len(calls) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, *text, **how)

    monkeypatch.setattr(Path, "write_text", fill)
    text = refusal(run("report"))
    assert "report.svg' cannot be written (No space left on device)" in text
    assert str(Path(bpy.context.scene.kiriko.report_folder) / "report.svg") in text
    assert state() == before


def test_the_command_line_writes_all_files_or_none(rig, tmp_path, monkeypatch, capsys):
    """On a full disk, and after errors that nobody foresaw, the earlier files stay.

    One sentence, exit code 1.
    """
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    command = part("operators.cli.command_line")
    folder = Path(bpy.context.scene.kiriko.report_folder)
    words = ["solve", "--out", str(folder), "--overwrite"]

    assert command.run(words) == 0
    before = files()
    sizes = {name: len(content) for name, content in before.items()}
    bpy.context.scene.kiriko.margin = 2
    capsys.readouterr()
    with full_disk(max(sizes.values()) - 1):  # some of the files have room
        assert command.run(words) == 1
    (line,) = capsys.readouterr().err.splitlines()

    assert line.startswith("kiriko: The file")
    assert is_sentence(line)
    assert files() == before
    for error in errors()[1:FEW]:
        with broken("write", error):
            assert command.run(words) == 1
        assert is_sentence(capsys.readouterr().err.splitlines()[-1])
        assert files() == before

    new = tmp_path / "a" / "b"
    with full_disk():
        assert command.run(["solve", "--out", str(new)]) == 1
    assert not new.parent.exists()


@pytest.mark.parametrize("is_live", [False, True])
def test_the_source_is_saved_with_the_file_where_temporary_files_have_no_room(
    rig, tmp_path, is_live
):
    """An image that cannot be compressed by way of a file is packed as it
    is: the same numbers after saving and loading.
    """
    with full_disk():
        if is_live:
            bpy.ops.kiriko.live()
            settle()
            bpy.ops.kiriko.live()
        else:
            bpy.ops.kiriko.solve()

    before = product("solve")
    assert bpy.context.scene.kiriko.result.source.packed_file is not None
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rig.blend"))

    assert product("solve") == before
    assert before == whole("solve")
