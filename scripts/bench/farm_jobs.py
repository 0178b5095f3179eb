"""Jobs for many machines, run by the command line of Open Job Description and by two processes.

Blender is its module, which tests/known/as_blender.py gives the program's options. Each worker has
factory settings and Kiriko's zip, as on a farm; names have spaces and Japanese.
"""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

import bpy

from environments import ROOT
from kiriko.core.lab.farm.job import LOG
from known.registered import registered

from .runner import Row, proof

FRAMES = "1-12"
N_FRAMES = 12
CHUNK = 5
KILLED_AFTER = 2  # files
HEADS = "--right", "-30", "30", "--up", "0", "20", "--tolerance", "0.1"
SHARES = 3
PATIENCE = 900.0  # s, for a job
AS_BLENDER = ROOT / "tests" / "known" / "as_blender.py"


def proofs(interpreter: Path, folder: Path) -> Iterator[Row]:
    """All proofs of jobs; `interpreter` has openjd-cli, `folder` is empty."""
    zips = sorted((ROOT / "dist").glob("kiriko-*-linux_x64.zip"))
    if not zips:
        sys.exit("There is no zip in dist/: run 'python3 scripts/dev.py build' first.")
    openjd = interpreter.parent / "openjd"
    place = folder / "金魚 farm"
    place.mkdir()
    program = _program(place)
    blend = rig(place)
    bundle = place / "a job"
    arguments = ["--frames", FRAMES, "--chunk", str(CHUNK), "--zip", str(zips[-1])]
    run_verb("job", *arguments, "--out", str(bundle))

    words = _worker_words(program, bundle, blend, place / "single")
    single, one = _timed(lambda: subprocess.run(words, capture_output=True, timeout=PATIENCE))
    files = contents(place / "single")
    yield proof(
        "one process",
        f"{len(files)} images; {_costs(one, place / 'single', 1)}",
        single.returncode == 0 and len(files) == N_FRAMES,
    )

    check = subprocess.run([openjd, "check", bundle / "template.json"], capture_output=True)
    yield proof("openjd check", f"exit code {check.returncode}", check.returncode == 0)

    run = _openjd(openjd, bundle, program)
    out = bundle / "source"
    is_same = contents(out) == files
    yield proof(
        f"{N_FRAMES} frames in chunks of {CHUNK} by openjd run",
        f"exit code {run.returncode}, images {'' if is_same else 'not '}equal to the bit",
        run.returncode == 0 and is_same,
    )

    yield _killed(openjd, bundle, program, files)
    yield _missing(openjd, bundle, program)
    yield _side_by_side(program, bundle, blend, place / "two", files)
    bundle = place / "an atlas"
    run_verb("atlas", *HEADS, "--job", str(SHARES), "--zip", str(zips[-1]), "--out", str(bundle))
    yield from _atlas(openjd, bundle, program, blend)


def _atlas(openjd: Path, bundle: Path, program: Path, blend: Path) -> Iterator[Row]:
    """An atlas made by tasks is equal to the atlas of a single run."""
    single = bundle.with_name("one atlas")
    words = _kiriko(program, bundle, blend, "atlas", *HEADS, "--out", single)
    subprocess.run(words, capture_output=True, timeout=PATIENCE, check=True)
    files = contents(single, "*.npz")

    run = _openjd(openjd, bundle, program)
    is_same = contents(bundle / "source", "*.npz") == files
    yield proof(
        f"an atlas of {len(files)} places in {SHARES} tasks by openjd run",
        f"exit code {run.returncode}, maps {'' if is_same else 'not '}equal to the bit",
        run.returncode == 0 and is_same,
    )
    yield _killed(openjd, bundle, program, files, "*.npz")


def contents(folder: Path, pattern: str = "*.png") -> dict[str, bytes]:
    """The images, or other files, in a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.glob(pattern))}


def _killed(
    openjd: Path, bundle: Path, program: Path, files: dict[str, bytes], pattern: str = "*.png"
) -> Row:
    """A job whose processes are killed within a task leaves whole files, and is run again."""
    out = bundle / "source"
    shutil.rmtree(out, ignore_errors=True)
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    job = subprocess.Popen(_words(openjd, bundle, program), start_new_session=True, **silent)
    until = perf_counter() + PATIENCE
    while len(contents(out, pattern)) < KILLED_AFTER and job.poll() is None:
        if perf_counter() > until:
            break
        time.sleep(0.05)
    for process in _tree(job.pid):
        os.kill(process, signal.SIGKILL)
    job.wait()

    left = contents(out, pattern)
    are_whole = all(files.get(name) == data for name, data in left.items())
    again = _openjd(openjd, bundle, program)
    is_same = contents(out, pattern) == files
    return proof(
        "killed within a task, and run again",
        f"{len(left)} of {len(files)} files were left, {'all' if are_whole else 'not all'} whole;"
        f" then exit code {again.returncode}, files {'' if is_same else 'not '}equal to the bit",
        are_whole and 0 < len(left) < len(files) and again.returncode == 0 and is_same,
    )


def _tree(top: int) -> list[int]:
    """A process and all its descendants, which may have sessions of their own."""
    children: dict[int, list[int]] = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(status.read_text(errors="replace").rpartition(")")[2].split()[1])
        except OSError:  # ended meanwhile
            continue
        children.setdefault(parent, []).append(int(status.parent.name))
    found = [top]
    for process in found:
        found += children.get(process, [])
    return found


def _missing(openjd: Path, bundle: Path, program: Path) -> Row:
    """A bundle whose .blend is gone fails with its sentence."""
    (blend,) = bundle.glob("*.blend")
    aside = blend.rename(blend.with_suffix(".aside"))
    run = _openjd(openjd, bundle, program)
    aside.rename(blend)
    told = "No .blend file was loaded" in run.stdout + run.stderr
    return proof(
        "the .blend is missing",
        f"exit code {run.returncode}, its sentence is {'' if told else 'not '}told",
        run.returncode != 0 and told,
    )


def _side_by_side(
    program: Path, bundle: Path, blend: Path, out: Path, files: dict[str, bytes]
) -> Row:
    """Two processes share the frames of one folder."""

    def both() -> list[int]:
        words = _worker_words(program, bundle, blend, out, "--placeholders")
        running = [subprocess.Popen(words, stdout=subprocess.DEVNULL) for _ in range(2)]
        return [process.wait(PATIENCE) for process in running]

    codes, seconds = _timed(both)
    is_same = contents(out) == files
    return proof(
        "two processes, one folder",
        f"images {'' if is_same else 'not '}equal to the bit; {_costs(seconds, out, 2)}",
        codes == [0, 0] and is_same,
    )


def _costs(seconds: float, out: Path, n: int) -> str:
    """Frames per hour, seconds per frame, and overhead seconds of each process."""
    frames = [json.loads(line)["seconds"] for line in (out / LOG).read_text("utf-8").splitlines()]
    overhead = seconds - sum(frames) / n
    return (
        f"{3600 * N_FRAMES / seconds:.0f} frames an hour, {sum(frames) / len(frames):.2f} s a"
        f" frame, {overhead:.1f} s of overhead"
    )


def _timed(work):
    started = perf_counter()
    found = work()
    return found, perf_counter() - started


def _program(folder: Path) -> Path:
    """A program in place of `blender`."""
    path = folder / "blender"
    python = shlex.quote(sys.executable)
    path.write_text(
        f'#!/bin/sh\nunset PYTHONPATH\nexec {python} -P {shlex.quote(str(AS_BLENDER))} "$@"\n',
        encoding="utf-8",
    )
    path.chmod(0o755)
    os.environ["BLENDER_USER_RESOURCES"] = str(folder / "profile")
    return path


def rig(folder: Path, viewer: int = 64, display: tuple[int, int] = (96, 64)) -> Path:
    """A small rig whose glass turns, saved."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    registered()
    glass = bpy.context.active_object
    glass.dimensions = (0.03,) * 3
    bpy.ops.kiriko.add_rig(viewer_resolution=viewer, display_resolution=display)
    for frame, turn in ((1, 0.1), (N_FRAMES, 0.6)):
        glass.rotation_euler.z = turn
        glass.keyframe_insert("rotation_euler", frame=frame)
    path = folder / "金魚 rig.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def run_verb(*words: str) -> None:
    """Kiriko's command line, on the open file."""
    from kiriko.operators.cli import command_line

    if command_line.run(list(words)) != 0:
        sys.exit(f"kiriko {words[0]} failed.")


def _worker_words(program: Path, bundle: Path, blend: Path, out: Path, *more: str) -> list[str]:
    return _kiriko(program, bundle, blend, "solve", f"--frames={FRAMES}", *more, "--out", out)


def _kiriko(program: Path, bundle: Path, blend: Path, *verb: str | Path) -> list[str]:
    """The command line of a worker that runs a verb."""
    script = bundle / "kiriko" / "kiriko_bootstrap.py"
    options = ["--background", blend, "--factory-startup", "--python-exit-code", "1"]
    return [str(word) for word in (program, *options, "--python", script, "--", *verb)]


def _words(openjd: Path, bundle: Path, program: Path) -> list[str]:
    return [str(openjd), "run", str(bundle / "template.json"), "-p", f"Blender={program}"]


def _openjd(openjd: Path, bundle: Path, program: Path) -> subprocess.CompletedProcess:
    """Run a whole job."""
    options = {"capture_output": True, "encoding": "utf-8", "timeout": PATIENCE}
    return subprocess.run(_words(openjd, bundle, program), **options)
