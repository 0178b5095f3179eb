"""An atlas is planned: how fine its grid has to be, and what of an atlas that is there stays."""

from collections.abc import Generator, Iterable
from dataclasses import replace
from pathlib import Path

from ...base.errors import ImageError, RigError
from .atlas import INDEX, Atlas, map_name, new, read, write
from .heads import HeadBox
from .making import Making, missing
from .refine import check, refine


def planned(
    making: Making, box: HeadBox, tolerance: float, most: int, overwrite: bool, remedy: str
) -> Generator[float, None, Atlas]:
    """Find how fine the grid has to be, and write the index; yields progress 0..1.

    Maps in the folder that are of the same rig stay, others go where they may. Source images that
    are asked for later are made beside the maps; those that are there stay, asked for or not.

    Raises
    ------
    RigError, MeshError : the rig cannot be solved somewhere in the box, or not finely enough
    ImageError : an atlas of another rig or box, or source images of another picture, are there, and
        `overwrite` is not set; `remedy` ends the sentence
    """
    rig = making.rig
    check(rig, making.viewer, box, tolerance, most)
    before = read(making.folder)
    is_of_rig = before is not None and before.rig == making.key
    if before is not None and not is_of_rig and not overwrite:
        raise ImageError(
            "The folder '{folder}' has the atlas of another rig: choose another or {remedy}.",
            folder=making.folder,
            remedy=remedy,
        )
    image_key = _image_key(making, before if is_of_rig else None, overwrite, remedy)
    if is_of_rig and (before.grid.box, before.tolerance) == (box, tolerance):
        if before.image_key == image_key:
            return before
        atlas = replace(before, image_key=image_key)
    else:
        if _has_places_of_another_box(making.folder, before, box) and not overwrite:
            raise ImageError(
                "The folder '{folder}' has the atlas of a head in another box: choose another"
                " folder or {remedy}.",
                folder=making.folder,
                remedy=remedy,
            )
        refined = yield from refine(making.at, box, rig.picture_place, tolerance, most)
        if image_key is None:  # else their source images are wanted, too
            found = refined.maps.items()
            making.known.update((map_name(offset), one) for offset, one in found)
        atlas = new(rig, making.viewer, making.key, refined, tolerance, image_key)

    write(making.folder, atlas)
    if before is not None:
        kept = set(atlas.maps) if is_of_rig else set()
        kept |= set(atlas.images) if before.image_key == image_key else set()
        _remove(making.folder, {*before.maps, *before.images} - kept)
    return atlas


def _image_key(making: Making, before: Atlas | None, overwrite: bool, remedy: str) -> str | None:
    """Fingerprint of the source images that an atlas has; None where there are to be none.

    before : the atlas of the same rig that is there
    """
    if before is not None and before.has_images:
        if before.image_key == making.image_key:
            return making.image_key
        if not overwrite:
            raise ImageError(
                "The folder '{folder}' has source images of another picture, or in another light:"
                " choose another folder or {remedy}.",
                folder=making.folder,
                remedy=remedy,
            )
    return making.image_key if making.has_images else None


def _has_places_of_another_box(folder: Path, atlas: Atlas | None, box: HeadBox) -> bool:
    """Are files of an atlas there that would go, since hardly a place of another box is one of
    this one?
    """
    if atlas is None or atlas.grid.box == box:
        return False
    return len(missing(folder, atlas)) < len(atlas.grid)


def _remove(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as reason:
            raise ImageError(
                "The file '{path}' of an earlier atlas cannot be removed ({why}): remove it"
                " yourself.",
                path=folder / name,
                why=reason.strerror,
            ) from None


def planned_before(making: Making) -> Atlas:
    """The atlas whose index is in the folder; RigError where it is of another rig, or its source
    images are of another picture.
    """
    atlas = read(making.folder)
    if atlas is None:
        raise ImageError(
            "The folder '{folder}' has no {index}: plan the atlas first.",
            folder=making.folder,
            index=INDEX,
        )
    if atlas.rig != making.key:
        raise RigError(
            "The rig is not the one that the atlas in '{folder}' was planned for: plan it anew.",
            folder=making.folder,
        )
    if atlas.has_images and atlas.image_key != making.image_key:
        raise RigError(
            "The picture, or its light, is not the one that the source images in '{folder}' were"
            " planned for: plan them anew.",
            folder=making.folder,
        )
    if making.has_images and not atlas.has_images:
        raise RigError(
            "The atlas in '{folder}' was planned without source images: plan it anew with them, and"
            " its maps stay.",
            folder=making.folder,
        )
    return atlas
