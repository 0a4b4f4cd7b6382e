"""Builds with the tools and flags that the seeding read from the core's platform.txt. For SCons."""

import json
from pathlib import Path

from SCons.Script import Builder, Default, DefaultEnvironment

env = DefaultEnvironment()
recipes = json.loads(Path(env.PioPlatform().get_dir(), "recipes.json").read_text("utf-8"))

env.Replace(
    PROGNAME="firmware",
    PROGSUFFIX=".elf",
    **recipes["tools"],
    CFLAGS=recipes["c"],
    CXXFLAGS=recipes["cpp"],
    ASPPFLAGS=recipes["S"],
    LINKFLAGS=recipes["link"],
    LIBS=["m"],
    SIZEPROGREGEXP=recipes["size"]["flash"],
    SIZEDATAREGEXP=recipes["size"]["ram"],
    SIZECHECKCMD="$SIZETOOL -A $SOURCES",
)
# A text is written with its quotation marks, which have to pass through the shell.
env.Append(
    CPPDEFINES=[
        (name, env.StringifyMacro(value[1:-1])) if value.startswith('"') else (name, value)
        for name, value in recipes["defines"]
    ],
    BUILDERS={
        "Hex": Builder(
            action=env.VerboseAction(
                " ".join(["$OBJCOPY", *recipes["hex"], "$SOURCES", "$TARGET"]), "Building $TARGET"
            ),
            suffix=".hex",
        )
    },
)

Default(env.Hex("$BUILD_DIR/${PROGNAME}", env.BuildProgram()))
