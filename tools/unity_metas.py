# SPDX-License-Identifier: Apache-2.0
"""Writes the `.meta` files of the Unity package: ``python -m tools.unity_metas``.

Unity identifies each asset by the GUID in the `.meta` file beside it. A package that is installed
from a URL or an archive is read-only, so it must contain these files. A GUID is the MD5 of the
package's name and the path in it: the same in every copy.
"""

import hashlib
import json
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "udp-bridge" / "csharp"


def metas() -> dict[Path, str]:
    """Return the path and the text of each `.meta` file."""
    name = json.loads((PACKAGE / "package.json").read_text(encoding="utf-8"))["name"]
    assets = (path for path in PACKAGE.rglob("*") if path.suffix != ".meta")
    return {
        asset.with_name(f"{asset.name}.meta"): _meta(
            f"{name}/{asset.relative_to(PACKAGE).as_posix()}", is_folder=asset.is_dir()
        )
        for asset in sorted(assets)
    }


def main() -> None:
    """Write the files; remove those whose asset is gone."""
    wanted = metas()
    for file in PACKAGE.rglob("*.meta"):
        if file not in wanted:
            file.unlink()
    for file, text in wanted.items():
        file.write_text(text, encoding="utf-8")


def _meta(identity: str, *, is_folder: bool) -> str:
    """Return the content for an asset; Unity adds the importer's defaults."""
    guid = hashlib.md5(identity.encode(), usedforsecurity=False).hexdigest()
    return f"fileFormatVersion: 2\nguid: {guid}\n" + "folderAsset: yes\n" * is_folder


if __name__ == "__main__":
    main()
