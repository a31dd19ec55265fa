"""Packs a built library as a wheel, to be tested as it is installed: `pack.py LIBRARY FOLDER`. Wheels for others are those of
packaging/wheel, by maturin."""

import base64
import hashlib
import pathlib
import re
import sys
import zipfile

SOURCES = pathlib.Path(__file__).parents[1]


def main(library, folder):
    version = re.search(r'^version = "(.*)"', (SOURCES.parent / "Cargo.toml").read_text(), re.MULTILINE).group(1)
    project = (SOURCES / "pyproject.toml").read_text()
    needs = re.search(r"^dependencies = \[(.*)\]", project, re.MULTILINE).group(1).replace('"', "").split(", ")
    script = re.search(r'^relume = "(.*)"', project, re.MULTILINE).group(1)
    info = f"relume-{version}.dist-info"
    requires = "".join(f"Requires-Dist: {name}\n" for name in needs)
    files = {f"relume/{file.name}": file.read_bytes() for file in (SOURCES / "relume").iterdir() if file.is_file()}
    files["relume/_relume.abi3.so"] = pathlib.Path(library).read_bytes()
    files[f"{info}/METADATA"] = f"Metadata-Version: 2.1\nName: relume\nVersion: {version}\n{requires}".encode()
    files[f"{info}/WHEEL"] = b"Wheel-Version: 1.0\nGenerator: pack.py\nRoot-Is-Purelib: false\nTag: cp39-abi3-linux_x86_64\n"
    files[f"{info}/entry_points.txt"] = f"[console_scripts]\nrelume = {script}\n".encode()
    record = f"{info}/RECORD"
    lines = [f"{name},sha256={digest(data)},{len(data)}\n" for name, data in files.items()] + [f"{record},,\n"]
    files[record] = "".join(lines).encode()
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.whl"):
        old.unlink()
    with zipfile.ZipFile(folder / f"relume-{version}-cp39-abi3-linux_x86_64.whl", "w") as wheel:
        for name, data in files.items():
            wheel.writestr(name, data)


def digest(data):
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


if __name__ == "__main__":
    main(*sys.argv[1:])
