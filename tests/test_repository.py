"""package.xml agrees with what is imported and with pip, and generated files are up to date."""

import re
import tomllib
import xml.etree.ElementTree as ElementTree

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from tools.generate_docs import generated


@pytest.fixture(scope="module")
def requirements(repository) -> dict[str, Requirement]:
    """The requirements of the package and its extras, by their text in pyproject.toml."""
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    texts = [*project["dependencies"], *(text for extra in project["optional-dependencies"].values() for text in extra)]
    return {text: Requirement(text) for text in texts if not text.startswith("srt3d_ros[")}


OF_ROSDEP = {"yaml": "python3-yaml"} | {name: f"python3-{name}" for name in ("numpy", "scipy", "tqdm", "jsonschema")}


def test_package_xml_names_all_that_is_imported_and_agrees_with_pip_on_what_both_install(requirements, repository):
    package = ElementTree.parse(repository / "package.xml").getroot()
    bounds = {node.text: node.attrib for node in package.iter("exec_depend")}
    assert len(bounds) > 10 and all({"version_gte", "version_lt"} == set(both) for both in bounds.values())
    sources = [path for folder in ("srt3d_ros", "launch") for path in (repository / folder).rglob("*.py")]
    text = "\n".join(path.read_text() for path in sources)
    imported = set(re.findall(r"^ *(?:from|import) (\w+)", text, re.MULTILINE))
    used = {OF_ROSDEP.get(name, name) for name in imported if re.match(r"rcl|launch|ament", name) or name in OF_ROSDEP}
    used.update(re.findall(r"\b([a-z]+_(?:msgs|interfaces))(?:\.|/msg/)", text))
    assert {"rclpy", "nav_msgs", "python3-yaml"} <= used <= bounds.keys(), used - bounds.keys()
    for key, name in (("python3-numpy", "numpy"), ("python3-scipy", "scipy"), ("python3-tqdm", "tqdm")):
        wanted = next(wanted.specifier for wanted in requirements.values() if wanted.name == name)
        assert wanted == SpecifierSet(f">={bounds[key]['version_gte']},<{bounds[key]['version_lt']}"), key


def test_generated_files_are_up_to_date(repository):
    for path, text in generated().items():
        assert (repository / path).read_text(encoding="utf-8") == text, f"{path}: run python -m tools.generate_docs"
