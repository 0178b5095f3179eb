"""A user's Blender: adds a repository, installs Kiriko, updates it, solves, and removes it.

Arguments: folder of the repository, with the old zip; its address; the new zip. It runs in a
process of its own, as an extension that is enabled twice would register its classes twice.
"""

import shutil
import sys
import tomllib
from pathlib import Path

import bpy

import package


def installed(place: Path) -> str:
    """Version of the extension in a folder."""
    return tomllib.loads((place / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]


def main(folder: Path, address: str, new: Path) -> None:
    """Play the user; prints a line for each step."""
    preferences = bpy.context.preferences
    preferences.system.use_online_access = True
    repos = preferences.extensions.repos
    repo = repos.new(name="Kiriko", module="own", remote_url=f"{address}/index.json")
    here = {"repo_index": list(repos).index(repo)}
    place = Path(repo.directory, "kiriko")
    module = f"bl_ext.{repo.module}.kiriko"

    bpy.ops.extensions.repo_sync(**here)
    bpy.ops.extensions.package_install(**here, pkg_id="kiriko", enable_on_install=True)
    assert module in preferences.addons
    sys.stdout.write(f"USER installed {installed(place)}\n")

    for path in folder.glob("*.zip"):
        path.unlink()
    shutil.copy(new, folder)
    package.extension_tool("server-generate", "--repo-dir", folder, "--html")
    bpy.ops.extensions.repo_sync(**here)
    bpy.ops.extensions.package_upgrade_all()
    sys.stdout.write(f"USER updated to {installed(place)}\n")

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.preferences.addon_enable(module=module)
    bpy.ops.kiriko.add_rig(viewer_resolution=64, display_resolution=(64, 64))
    sys.stdout.write(f"USER solved {bpy.ops.kiriko.solve()}\n")

    bpy.ops.extensions.package_uninstall(**here, pkg_id="kiriko")
    sys.stdout.write(f"USER removed {not place.exists() and module not in preferences.addons}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
