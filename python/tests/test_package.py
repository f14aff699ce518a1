"""The package as it is installed."""

import ast
import importlib.metadata
import inspect
import os
import pathlib
import subprocess
import sys

import forcerig
import pytest
from forcerig import _native

FOLDER = pathlib.Path(forcerig.__file__).parent
REPOSITORY = pathlib.Path(__file__).parents[2]


def test_it_is_the_installed_one_of_this_version():
    assert REPOSITORY not in FOLDER.parents or "site-packages" in FOLDER.parts
    metadata = importlib.metadata.metadata("forcerig")
    manifest = (REPOSITORY / "Cargo.toml").read_text()
    assert f'version = "{metadata["Version"]}"' in manifest
    assert metadata["License-Expression"] == "MIT OR Apache-2.0"
    assert {"pandas", "polars"} <= set(metadata.get_all("Provides-Extra"))


def test_no_text_of_the_wheel_names_a_folder_of_this_computer():
    home = os.path.expanduser("~")
    texts = 0
    for file in importlib.metadata.files("forcerig"):
        # Pip's own notes of where it found the package are in no wheel.
        if file.suffix in (".so", ".pyd", ".pyc") or file.name in ("direct_url.json", "RECORD", "INSTALLER", "REQUESTED"):
            continue
        text = file.locate().read_text(encoding="utf-8")
        assert str(REPOSITORY) not in text and f"{home}/" not in text, file
        texts += 1
    assert texts > 10 and not any("tests" in file.parts for file in importlib.metadata.files("forcerig"))


def stub(name):
    return ast.parse((FOLDER / name).read_text()).body


def test_stubs_name_what_there_is():
    named = {alias.asname for node in stub("__init__.pyi") for alias in node.names}
    assert named == set(forcerig.__all__) and (FOLDER / "py.typed").is_file()
    for name in forcerig.__all__:
        assert inspect.getdoc(getattr(forcerig, name)), name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        forcerig.nothing  # noqa: B018


def parameters(function):
    return [name for name in inspect.signature(function).parameters if name != "self"]


def test_stubs_of_the_extension_have_its_names_and_parameters():
    functions = {node.name: node for node in stub("_native.pyi") if isinstance(node, ast.FunctionDef)}
    classes = {node.name: node for node in stub("_native.pyi") if isinstance(node, ast.ClassDef)}
    there = {name for name in vars(_native) if not name.startswith("_")}
    assert there == set(functions) | set(classes)

    def same(node, function):
        arguments = [argument.arg for argument in node.args.args if argument.arg != "self"]
        assert arguments == parameters(function), node.name

    for name, node in functions.items():
        same(node, getattr(_native, name))
    for name, node in classes.items():
        own = getattr(_native, name)
        methods = [part for part in node.body if isinstance(part, ast.FunctionDef)]
        public = {name for name in vars(own) if not name.startswith("_")}
        if name != "Refused":
            assert public == {method.name for method in methods}, name
        for method in methods:
            same(method, getattr(own, method.name))


def test_the_client_alone_needs_no_packages():
    script = "import sys; import forcerig; assert not {'numpy', 'forcerig._native'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", script], check=True)
