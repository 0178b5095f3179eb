"""Movies, decoded where there is no Blender: `python -m bench.film_reader FOLDER`, run by
`dev.py farm`. Beside each movie of a folder it writes its frames (n, h, w, 3), size and rate.
"""

import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np

SUFFIXES = {".mp4", ".mov", ".mkv"}
# exact, or the way back from 4:2:0 would be as far off as the way there; and by the matrix that the
# files name (of 10 and 12 bits, ffmpeg 7 takes another)
EXACT = [
    *("-sws_flags", "accurate_rnd+full_chroma_int+bicubic"),
    *("-vf", "scale=in_color_matrix=bt709"),
]


def read(path: Path) -> None:
    """Decode a movie, each of its frames once."""
    frames = imageio_ffmpeg.read_frames(path, output_params=[*EXACT, "-fps_mode", "passthrough"])
    about = next(frames)
    width, height = about["size"]
    found = [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in frames]
    rate, codec = about["fps"], about["codec"]
    np.savez(path.with_suffix(".npz"), frames=np.stack(found), rate=rate, codec=codec)


if __name__ == "__main__":
    for movie in sorted(Path(sys.argv[1]).iterdir()):
        if movie.suffix in SUFFIXES:
            read(movie)
