"""Programs that read Kiriko's files without Blender: OpenCV and ffmpeg.

`python -m bench.readers FOLDER`, run by `dev.py farm`, warps picture.npy (h, w, 3) by the maps of a
folder and writes an image for each reader next to them, row 0 at the top. Without a picture it
decodes each movie, and writes its frames (n, h, w, 3), rate and codec next to it.
"""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np

BITS = 65535
# accurate rounding, or decoding 4:2:0 would add as much error as encoding it; and the matrix named
# in the file (for 10 and 12 bits, ffmpeg 7 assumes another)
EXACT = ["-sws_flags", "accurate_rnd+full_chroma_int+bicubic"]
BY_NAME = [*EXACT, "-vf", "scale=in_color_matrix=bt709"]
MOVIES = {".mp4", ".mov", ".mkv"}
FRAMES = 3  # of the film for the unchanged printed command


def by_opencv(folder: Path, picture: np.ndarray) -> None:
    """cv2.remap, on the picture's own numbers."""
    maps = np.load(folder / "warp.npz")
    warped = cv2.remap(picture, maps["map_x"], maps["map_y"], cv2.INTER_LINEAR)
    np.save(folder / "opencv.npy", warped)


def by_ffmpeg(folder: Path, picture: np.ndarray, times: int) -> None:
    """The printed command in 16 bits, for its coordinates, and unchanged, with a film of three
    frames; the picture is dark in the first and last.
    """
    height, width = picture.shape[:2]
    about = json.loads((folder / "maps.json").read_text())
    command = about["maps"][0]["ffmpeg"]["command"]
    columns, rows = about["display"]["size"]

    numbers = np.rint(picture / picture.max() * BITS).astype(">u2")
    still = folder / "picture.ppm"
    still.write_bytes(f"P6\n{width} {height}\n{BITS}\n".encode() + numbers.tobytes())
    precise = command.replace("format=gbrp[", "format=gbrp16le[")
    for last in ("yuv420p", "yuv444p"):
        precise = precise.replace(f"format={last}[v]", "format=gbrp16le[v]")
    raw = run(folder, precise, still.name, "-frames:v 1 -f rawvideo -pix_fmt rgb48le out.raw")
    found = np.frombuffer((folder / raw).read_bytes(), "<u2").reshape(rows, columns, 3)
    np.save(folder / f"ffmpeg_{times}.npy", found / BITS * picture.max())

    film = np.zeros((FRAMES, height, width, 3), np.uint8)
    film[1] = np.rint(picture / picture.max() * 255)
    (folder / "film.rgb").write_bytes(film.tobytes())
    source = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r 25 -i film.rgb"
    ffmpeg("-y", *source.split(), "-c:v", "ffv1", "film.mkv", folder=folder)
    run(folder, command, "film.mkv", "-c:v libx264 -qp 0 OUT.mp4")
    out = [*EXACT, *["-f", "rawvideo", "-pix_fmt", "rgb24", "film_out.rgb"]]
    ffmpeg("-y", "-i", "OUT.mp4", *out, folder=folder)
    frames = np.frombuffer((folder / "film_out.rgb").read_bytes(), np.uint8)
    frames = frames.reshape(-1, rows, columns, 3)
    if len(frames) != FRAMES or frames[0].max() > 8 or frames[-1].max() > 8:
        sys.exit(f"ffmpeg made {len(frames)} frames of {FRAMES}, or mixed them.")
    np.save(folder / f"film_{times}.npy", frames[1] / 255 * picture.max())


def run(folder: Path, command: str, picture: str, end: str) -> str:
    """Run a printed command on a picture, with another end; the name of the file it writes."""
    words = shlex.split(command.replace("PICTURE", picture).replace("OUT.mp4", end))
    ffmpeg("-y", *words[1:], folder=folder)
    return words[-1]


def ffmpeg(*words: str, folder: Path) -> None:
    """Run ffmpeg; leave with its words where it fails."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-loglevel", "error", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{shlex.join(command)}\n{done.stderr}")


def decode(path: Path) -> None:
    """Decode a movie, each of its frames once."""
    frames = imageio_ffmpeg.read_frames(path, output_params=[*BY_NAME, "-fps_mode", "passthrough"])
    about = next(frames)
    width, height = about["size"]
    found = [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in frames]
    rate, codec = about["fps"], about["codec"]
    np.savez(path.with_suffix(".npz"), frames=np.stack(found), rate=rate, codec=codec)


def main() -> None:
    folder = Path(sys.argv[1])
    if not (folder / "picture.npy").exists():
        for movie in sorted(path for path in folder.iterdir() if path.suffix in MOVIES):
            decode(movie)
        return
    picture = np.load(folder / "picture.npy")
    by_opencv(folder, picture)
    about = json.loads((folder / "maps.json").read_text())
    by_ffmpeg(folder, picture, about["maps"][0]["ffmpeg"]["times"])


if __name__ == "__main__":
    main()
