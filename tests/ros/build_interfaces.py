# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Build the package hmcvt_msgs from the generators of the wheels and a compiler, without CMake.

    python tests/ros/build_interfaces.py FOLDER

makes FOLDER/hmcvt_msgs, a Python package of the same messages and actions as `colcon build` makes
of hmcvt_msgs, for the middleware of the wheels alone. With FOLDER on PYTHONPATH the node finds it.
"""

import functools
import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

PACKAGE = "hmcvt_msgs"
SOURCES = Path(__file__).resolve().parents[2] / PACKAGE
SHARE = Path(sys.prefix) / "share"
INCLUDED = (
    "std_msgs",
    "builtin_interfaces",
    "action_msgs",
    "service_msgs",
    "unique_identifier_msgs",
)
SUPPORT = "rosidl_typesupport_fastrtps_c"
LINKED = (
    "rosidl_runtime_c",
    "rosidl_typesupport_c",
    SUPPORT,
    "rosidl_typesupport_fastrtps_cpp",
    "rosidl_typesupport_introspection_c",
    "fastcdr",
    "rmw",
    "rcutils",
    "rcpputils",
)
INTROSPECTION = "rosidl_typesupport_introspection_c"


def generate(folder: Path) -> None:
    """Write the sources of all interfaces."""
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    import rosidl_generator_c
    import rosidl_generator_py
    import rosidl_generator_type_description
    import rosidl_typesupport_c
    import rosidl_typesupport_fastrtps_c
    import rosidl_typesupport_introspection_c
    from rosidl_adapter import convert_to_idl
    from rosidl_parser import parser

    # Five generators parse each interface, which takes most of their time.
    parser.get_ast_from_idl_string = functools.cache(parser.get_ast_from_idl_string)

    relative = []
    sources = sorted([*SOURCES.glob("msg/*.msg"), *SOURCES.glob("action/*.action")])
    for path in sources:
        kind = path.parent.name
        target = folder / kind
        target.mkdir(parents=True, exist_ok=True)
        convert_to_idl(SOURCES, PACKAGE, Path(kind) / path.name, folder)
        relative.append(f"{kind}/{path.stem}.idl")
    dependencies = []
    for package in INCLUDED:
        for idl in (SHARE / package).glob("**/*.idl"):
            dependencies.append(f"{package}:{idl}")

    # Its sources have the names of those of rosidl_generator_c.
    apart = folder.parent / "introspection" / PACKAGE
    apart.mkdir(parents=True, exist_ok=True)

    def arguments(generator: str, output: Path = folder, **more: object) -> str:
        data = {
            "package_name": PACKAGE,
            "output_dir": str(output),
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
        arguments(
            "rosidl_generator_c",
            type_description_tuples=described,
            ros_interface_files=[str(path) for path in sources],
        )
    )
    rosidl_typesupport_fastrtps_c.generate_typesupport_fastrtps_c(
        arguments(SUPPORT, type_description_tuples=described)
    )
    rosidl_typesupport_introspection_c.generate_c(
        arguments(INTROSPECTION, apart, type_description_tuples=described)
    )
    rosidl_typesupport_c.generate_c(
        arguments("rosidl_typesupport_c", type_description_tuples=described),
        [SUPPORT, INTROSPECTION],
    )
    rosidl_generator_py.generate_py(
        arguments("rosidl_generator_py", type_description_tuples=described),
        ["rosidl_typesupport_c"],
    )
    _write_visibility(folder, "rosidl_generator_c")
    _write_visibility(folder, SUPPORT)
    _write_visibility(apart, INTROSPECTION)
    (folder / "__init__.py").touch()


def _write_visibility(folder: Path, generator: str) -> None:
    """Write the header that CMake makes of a template."""
    name = f"{generator}__visibility_control.h"
    text = (SHARE / generator / "resource" / f"{name}.in").read_text(encoding="utf-8")
    text = text.replace("@PROJECT_NAME@", PACKAGE)
    text = text.replace("@PROJECT_NAME_UPPER@", PACKAGE.upper())
    target = folder / "msg" / name
    target.parent.mkdir(exist_ok=True)
    target.write_text(text, encoding="utf-8")


def compile_package(folder: Path) -> Path:
    """Compile all sources into one extension module; return its path."""
    import numpy

    site = Path(sysconfig.get_path("purelib"))
    root = folder.parent
    include = [
        root,
        root / "introspection",
        numpy.get_include(),
        sysconfig.get_path("include"),
    ]
    include.append(Path(sys.prefix) / "include")
    include += [
        path for path in (Path(sys.prefix) / "include").iterdir() if path.is_dir()
    ]
    include += [path for path in site.glob("*/include") if path.is_dir()]
    flags = [f"-I{path}" for path in include]
    objects = []
    # Together where names do not collide: reading the headers takes longest.
    alone = sorted(folder.rglob("*__description.c"))
    apart = root / "introspection" / PACKAGE
    together = []
    for suffix in (".c", ".cpp"):
        everywhere = [*folder.rglob(f"*{suffix}"), *apart.rglob(f"*{suffix}")]
        sources = sorted(set(everywhere) - set(alone))
        everything = root / f"everything{suffix}"
        lines = [f'#include "{source}"' for source in sources]
        everything.write_text("\n".join(lines) + "\n", encoding="utf-8")
        together.append(everything)
    for source in (*alone, *together):
        target = f"{source}.o"
        compiler = ["g++", "-std=c++17"] if source.suffix == ".cpp" else ["gcc"]
        options = ["-O0", "-fPIC", "-w", *flags]
        subprocess.run(
            [*compiler, *options, "-c", str(source), "-o", target], check=True
        )
        objects.append(target)
    library = Path(sys.prefix) / "lib"
    patterns = [f"lib{name}__*_{kind}.so" for name in INCLUDED for kind in ("c", "py")]
    patterns += [f"lib{name}.so" for name in LINKED]
    used = [str(path) for pattern in patterns for path in library.glob(pattern)]
    # A message asks for its support by the name of a library; one library holds all of it.
    main_library = folder / f"lib{PACKAGE}__{SUPPORT}.so"
    _link(main_library, *objects, *used, f"-Wl,-rpath,{library}")
    other = folder / f"lib{PACKAGE}__{INTROSPECTION}.so"
    _link(other, str(main_library))
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    module = folder / f"{PACKAGE}_s__rosidl_typesupport_c{suffix}"
    _link(module, str(main_library), str(other))
    return module


def _link(target: Path, *inputs: str) -> None:
    """Link a shared library that is found by its name once it is loaded."""
    options = ["-Wl,--no-as-needed", "-Wl,-rpath,$ORIGIN", f"-Wl,-soname,{target.name}"]
    subprocess.run(["g++", "-shared", "-o", str(target), *options, *inputs], check=True)


def main() -> int:
    """Build the package in the folder of the command line."""
    folder = Path(sys.argv[1]).resolve() / PACKAGE
    generate(folder)
    print(compile_package(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
