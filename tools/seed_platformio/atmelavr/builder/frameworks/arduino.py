"""Adds the Arduino core's headers and, as an archive, its sources. For SCons."""

from pathlib import Path

from SCons.Script import DefaultEnvironment

env = DefaultEnvironment()
board = env.BoardConfig()
framework = Path(env.PioPlatform().get_package_dir("framework-arduino-avr"))
core = framework / "cores" / board.get("build.core")

env.Append(CPPPATH=[str(core), str(framework / "variants" / board.get("build.variant"))])
env.Prepend(LIBS=[env.BuildLibrary("$BUILD_DIR/FrameworkArduino", str(core))])
