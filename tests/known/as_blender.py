"""Python with bpy in place of the program `blender`, which the wheels of bpy do not have: its
options as far as workers of a farm use them, in the order in which they stand.
"""

import runpy
import sys
import traceback

import bpy


def main(words: list[str]) -> None:
    """Do what Blender does with such a command line."""
    sys.argv = ["blender", *words]  # as Blender has it: all words
    code = 0
    todo = words[: words.index("--")] if "--" in words else list(words)
    if "--factory-startup" in todo:  # before any file, wherever it stands
        bpy.ops.wm.read_factory_settings()
    while todo:
        word = todo.pop(0)
        if word in ("--background", "-b", "--enable-autoexec", "-y", "--factory-startup"):
            continue
        if word == "--python-exit-code":
            code = int(todo.pop(0))
        elif word in ("--python", "-P"):
            try:
                runpy.run_path(todo.pop(0), run_name="__main__")
            except Exception:
                traceback.print_exc()
                if code:
                    sys.exit(code)
        elif word.startswith("-"):
            sys.exit(f"as_blender knows no option {word}")
        else:
            _open(word)


def _open(path: str) -> None:
    """Open a file; Blender goes on without it where it cannot be read."""
    try:
        bpy.ops.wm.open_mainfile(filepath=path)
    except RuntimeError as reason:
        sys.stderr.write(f"{reason}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
