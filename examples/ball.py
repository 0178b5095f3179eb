"""A picture inside a glass ball: from plain arrays to the source image and its error."""

import numpy as np

from kiriko_optics import Display, Glass, Mesh, Picture, Plate, Rig, Viewer, solve, write

x, y, z = np.eye(3)  # metres; the viewer looks along y


def square(centre: np.ndarray, right: np.ndarray, up: np.ndarray, side: float) -> Mesh:
    """A square with UV coordinates."""
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(centre + side * (uv - 0.5) @ [right, up], halves, uv=uv[halves])


u, v = np.meshgrid(np.arange(64) * np.pi / 32, np.arange(33) * np.pi / 32)
unit = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1).reshape(-1, 3)
rows = np.arange(33 * 64).reshape(33, 64)
a, b, c, d = rows[:-1], rows[1:], np.roll(rows[1:], -1, 1), np.roll(rows[:-1], -1, 1)
faces = np.concatenate([np.stack([a, b, c], -1)[:-1], np.stack([a, c, d], -1)[1:]]).reshape(-1, 3)
ball = Mesh(0.025 * unit, faces, unit[faces], is_smooth=np.ones(len(faces), bool))
radius = np.hypot(*np.mgrid[-1:1:512j, -1:1:512j])
rings = np.cos(20 * radius) ** 2 * np.exp(-4 * radius**2)
image = np.stack([rings, rings, rings, np.ones_like(rings)], -1).astype(np.float32)
window = -0.025, 0.025, -0.025, 0.025  # left, right, bottom, top, at 1 m
eye = Viewer("Eye", "perspective", -y, np.array([x, z, y]), window, 512, 512)
rig = Rig(
    viewers=(eye,),
    glasses=(Glass("Ball", ball),),
    plates=(Plate("Plate", square(0.15 * y, x, (y + z) / 2**0.5, 0.488)),),
    displays=(Display("Display", square(0.15 * (y - z), x, y, 0.05), 512, 512),),
    pictures=(Picture("Rings", image, square(0 * y, x, z, 0.03)),),
)
solution = solve(rig)
error = np.sqrt(np.mean((solution.seen() - solution.ideal()) ** 2))
print(f"{solution.n_rays} rays, RMSE of the seen image {error:.5f}, white is 1")
write("source.png", solution.source, "PNG8", overwrite=True)
