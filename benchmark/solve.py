"""Solves the rigs of kiriko-bench with kiriko-optics: `python solve.py FOLDER [RIG ...]`, then
score.py.

Each glass is read as drawn: flat triangles with interpolated normals, as the reference landings
have them; `reference_ball` and `reference_cube` as the smooth surface and the solid they stand for.
"""

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np
import score

from kiriko_optics import Display, Glass, Mesh, Picture, Plate, Rig, Viewer, solve


def read_ply(path):
    """Vertices and normals (n, 3), and triangles (t, 3), of a binary PLY file."""
    data = path.read_bytes()
    header, _, body = data.partition(b"end_header\n")
    sizes = [int(line.split()[-1]) for line in header.splitlines() if line.startswith(b"element")]
    vertices = np.frombuffer(body, "<f4", 6 * sizes[0]).reshape(-1, 6).astype(float)
    face = np.dtype([("n", "u1"), ("corners", "<i4", 3)])
    triangles = np.frombuffer(body, face, sizes[1], vertices.nbytes // 2)["corners"]
    return vertices[:, :3], vertices[:, 3:], triangles.astype(np.int64)


def read_glass(path, surface):
    """The glass of a file; vertices that differ in their normals alone are one."""
    places, normals, triangles = read_ply(path)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices, number = np.unique(places, axis=0, return_inverse=True)
    return Mesh(
        vertices,
        number.reshape(-1)[triangles],
        normals[triangles],
        is_smooth=np.ones(len(triangles), bool),
        surface=surface,
    )


def rectangle(corners):
    """A rectangle with UV coordinates, from its lower left corner on."""
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(np.array(corners), halves, uv=uv[halves])


def read(name):
    """The rig of a name."""
    numbers = score.numbers(name)
    viewer, display = numbers["viewer"], numbers["display"]
    surface = "smooth" if name == "reference_ball" else "facets"
    mesh = read_glass(score.HERE / "rigs" / name / "glass.ply", surface)
    colours = score.picture()
    image = np.concatenate([colours, np.ones((*colours.shape[:2], 1))], axis=2)
    return Rig(
        viewers=(
            Viewer(
                "viewer", "perspective", np.array(viewer["position"]), np.array(viewer["axes"]),
                tuple(viewer["window"]), *viewer["pixels"],
            ),
        ),
        glasses=(Glass("glass", mesh, numbers["glass"]["index"]),),
        plates=(Plate("plate", rectangle(numbers["plate"]["corners"])),),
        displays=(Display("display", rectangle(display["corners"]), *display["pixels"]),),
        pictures=(
            Picture("picture", image.astype(np.float32), rectangle(numbers["picture"]["corners"])),
        ),
    )  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("rigs", nargs="*", default=score.names(), metavar="RIG")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for name in arguments.rigs:
        rig = read(name)
        started = perf_counter()
        solution = solve(rig)
        print(f"{name:20}  {perf_counter() - started:6.2f} s", flush=True)
        np.save(arguments.folder / f"{name}.npy", solution.source)
