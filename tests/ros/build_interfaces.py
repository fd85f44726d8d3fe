# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Build the package hmcvt_msgs from the generators of the wheels and a compiler, without CMake.

    python tests/ros/build_interfaces.py FOLDER

makes FOLDER/hmcvt_msgs, a Python package of the same messages as `colcon build` makes of
hmcvt_msgs, for the middleware of the wheels alone. With FOLDER on PYTHONPATH the node finds it.
"""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

PACKAGE = "hmcvt_msgs"
SOURCES = Path(__file__).resolve().parents[2] / PACKAGE
SHARE = Path(sys.prefix) / "share"
INCLUDED = ("std_msgs", "builtin_interfaces")
SUPPORT = "rosidl_typesupport_fastrtps_c"


def generate(folder: Path) -> None:
    """Write the sources of all interfaces."""
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    import rosidl_generator_c
    import rosidl_generator_py
    import rosidl_generator_type_description
    import rosidl_typesupport_c
    import rosidl_typesupport_fastrtps_c
    from rosidl_adapter import convert_to_idl

    relative = []
    for path in sorted(SOURCES.glob("msg/*.msg")):
        kind = path.parent.name
        target = folder / kind
        target.mkdir(parents=True, exist_ok=True)
        convert_to_idl(SOURCES, PACKAGE, Path(kind) / path.name, folder)
        relative.append(f"{kind}/{path.stem}.idl")
    dependencies = []
    for package in INCLUDED:
        for idl in (SHARE / package).glob("**/*.idl"):
            dependencies.append(f"{package}:{idl}")

    def arguments(generator: str, **more: object) -> str:
        data = {
            "package_name": PACKAGE,
            "output_dir": str(folder),
            "template_dir": str(SHARE / generator / "resource"),
            "idl_tuples": [f"{folder}:{path}" for path in relative],
            "ros_interface_dependencies": dependencies,
            "target_dependencies": [],
            **more,
        }
        path = folder / f"{generator}.json"
        path.write_text(json.dumps(data), encoding="utf-8")
        return str(path)

    rosidl_generator_type_description.generate_type_hash(
        arguments(
            "rosidl_generator_type_description",
            include_paths=[f"{name}:{SHARE / name}" for name in INCLUDED],
        )
    )
    described = [f"{path}:{(folder / path).with_suffix('.json')}" for path in relative]
    rosidl_generator_c.generate_c(
        arguments("rosidl_generator_c", type_description_tuples=described),
        disable_description_codegen=True,
    )
    rosidl_typesupport_fastrtps_c.generate_typesupport_fastrtps_c(
        arguments(SUPPORT, type_description_tuples=described)
    )
    rosidl_typesupport_c.generate_c(
        arguments("rosidl_typesupport_c", type_description_tuples=described), [SUPPORT]
    )
    rosidl_generator_py.generate_py(
        arguments("rosidl_generator_py", type_description_tuples=described),
        ["rosidl_typesupport_c"],
    )
    for generator in ("rosidl_generator_c", SUPPORT):
        _write_visibility(folder, generator)
    (folder / "__init__.py").touch()


def _write_visibility(folder: Path, generator: str) -> None:
    """Write the header that CMake makes of a template."""
    name = f"{generator}__visibility_control.h"
    text = (SHARE / generator / "resource" / f"{name}.in").read_text(encoding="utf-8")
    text = text.replace("@PROJECT_NAME@", PACKAGE)
    text = text.replace("@PROJECT_NAME_UPPER@", PACKAGE.upper())
    (folder / "msg" / name).write_text(text, encoding="utf-8")


def compile_package(folder: Path) -> Path:
    """Compile all sources into one extension module; return its path."""
    import numpy

    site = Path(sysconfig.get_path("purelib"))
    root = folder.parent
    include = [root, numpy.get_include(), sysconfig.get_path("include")]
    include += [
        path for path in (Path(sys.prefix) / "include").iterdir() if path.is_dir()
    ]
    include += [path for path in site.glob("*/include") if path.is_dir()]
    flags = [f"-I{path}" for path in include]
    objects = []
    # All of one language at once: reading the headers takes longest.
    for suffix, compiler in ((".c", ["gcc"]), (".cpp", ["g++", "-std=c++17"])):
        sources = sorted(folder.rglob(f"*{suffix}"))
        everything = root / f"everything{suffix}"
        lines = [f'#include "{source}"' for source in sources]
        everything.write_text("\n".join(lines) + "\n", encoding="utf-8")
        target = f"{everything}.o"
        options = ["-O0", "-fPIC", "-w", *flags]
        subprocess.run(
            [*compiler, *options, "-c", str(everything), "-o", target], check=True
        )
        objects.append(target)
    library = Path(sys.prefix) / "lib"
    used = [
        str(path) for name in INCLUDED for path in library.glob(f"lib{name}__*_c.so")
    ]
    used += [
        str(path) for name in INCLUDED for path in library.glob(f"lib{name}__*_py.so")
    ]
    used += [
        str(path)
        for name in (
            "rosidl_runtime_c",
            "rosidl_typesupport_c",
            SUPPORT,
            "rosidl_typesupport_fastrtps_cpp",
            "fastcdr",
            "rmw",
            "rcutils",
        )
        for path in library.glob(f"lib{name}.so*")
    ]
    module = (
        folder
        / f"{PACKAGE}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    )
    subprocess.run(
        ["g++", "-shared", "-o", str(module), *objects, *used, f"-Wl,-rpath,{library}"],
        check=True,
    )
    return module


def main() -> int:
    """Build the package in the folder of the command line."""
    folder = Path(sys.argv[1]).resolve() / PACKAGE
    generate(folder)
    print(compile_package(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
