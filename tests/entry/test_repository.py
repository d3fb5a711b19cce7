"""What the repository promises beside its code: light imports, configs that load, a README that is true."""

import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest

from sixway.core.config import Config, ConfigError, load_config
from sixway.generation.plan import DatasetConfig, Plan
from sixway.guide.march import GuideConfig
from sixway.reference.lightmaps import ReferenceConfig
from sixway.sim.scenario import ScenarioConfig
from sixway.training.flow import FlowTrainConfig
from sixway.training.loop import TrainConfig

ROOT = Path(__file__).parents[2]

MODELS = {
    "data": DatasetConfig,
    "guide": GuideConfig,
    "reference": ReferenceConfig,
    "sim": ScenarioConfig,
    "train": TrainConfig,
    "train/flow": FlowTrainConfig,
}
"""The model of every folder below configs/, and of the one file that is of another."""


def test_core_and_shading_load_no_heavy_framework() -> None:
    program = """
import importlib, pkgutil, sys
import sixway, sixway.core, sixway.shading
rooms = (sixway.core, sixway.shading)
names = [found.name for room in rooms for found in pkgutil.iter_modules(room.__path__, room.__name__ + ".")]
for name in names:
    importlib.import_module(name)
print(len(names), *sorted({"torch", "warp", "mitsuba", "drjit", "kornia", "onnxruntime"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    count, *heavy = done.stdout.split()
    assert int(count) >= 10
    assert heavy == []
    assert done.stderr == ""


def model_of(path: Path) -> type[Config]:
    folder = path.relative_to(ROOT / "configs").parts[0]
    assert folder in MODELS, f"configs/{folder}: say in MODELS which model reads this folder"
    return MODELS.get(f"{folder}/{path.stem}", MODELS[folder])


@pytest.mark.parametrize(
    "path", sorted(ROOT.glob("configs/**/*.yaml")), ids=lambda path: f"{path.parent.name}/{path.stem}"
)
def test_every_config_loads_and_says_how_to_use_it(path: Path) -> None:
    config = load_config(model_of(path), path)
    if isinstance(config, DatasetConfig):
        assert Plan.read(path, ()).simulations  # its scenarios load as well
    head = path.read_text().split("\n\n")[0]
    assert all(line.startswith("#") for line in head.splitlines()), "a config begins with a header of comments"
    assert "Hardware and time:" in head


def test_every_folder_of_configs_is_known() -> None:
    found = {path.name for path in (ROOT / "configs").iterdir() if path.is_dir() and any(path.rglob("*.yaml"))}
    assert {"data", "sim", "train"} <= found <= set(MODELS)
    assert not list((ROOT / "configs").glob("*.yaml"))


# README


def commands_of(text: str) -> list[list[str]]:
    """Words of each command line in the fenced bash blocks."""
    blocks = re.findall(r"^```(?:bash|sh|console)\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line.removeprefix("$ "), comments=True))]


def python_commands(text: str) -> list[tuple[str, list[str]]]:
    """(module or script, arguments) of what is run by python or torchrun."""
    found = []
    for words in commands_of(text):
        match words:
            case [program, "-m", module, *arguments] if Path(program).name.startswith("python"):
                found.append((module, arguments))
            case [program, path, *arguments] if Path(program).name.startswith("python") and path.endswith(".py"):
                found.append((path, arguments))
            case ["torchrun", *arguments] if "-m" in arguments:
                at = arguments.index("-m")
                found.append((arguments[at + 1], arguments[at + 2 :]))
    return found


def faults(text: str, help_of: Callable[[str], str]) -> list[str]:
    """What a reader of these commands would stumble over."""
    wrong = []
    for target, arguments in python_commands(text):
        is_script = target.endswith(".py")
        if not ((ROOT / target).is_file() if is_script else find_spec(target)):
            wrong.append(f"{target}: there is no such program")
            continue
        for argument in arguments:
            if re.match(r"(configs|tests|scripts|data_gen)/", argument) and not (ROOT / argument).exists():
                wrong.append(f"{target}: {argument} does not exist")
        if target.startswith(("sixway.", "data_gen/")):
            known = set(re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", help_of(target)))
            for argument in arguments:
                option = argument.partition("=")[0]
                if re.match(r"--?[a-zA-Z]", argument) and option not in known:
                    wrong.append(f"{target}: unknown option {option}")
    return wrong


@pytest.fixture
def help_of(run: Callable) -> Callable[[str], str]:
    def text(target: str) -> str:
        name = "generate" if target.startswith("data_gen/") else target.removeprefix("sixway.")
        done = run(name, "--help")
        assert done.status == 0
        return done.out

    return text


def test_commands_of_the_readme_exist(help_of: Callable[[str], str]) -> None:
    text = (ROOT / "README.md").read_text()
    named = {target for target, _ in python_commands(text)}
    assert len(python_commands(text)) >= 6
    assert {"data_gen/generate.py", "sixway.train", "sixway.evaluate", "sixway.export", "sixway.relight"} <= named
    assert faults(text, help_of) == []


def test_configs_and_overrides_of_the_readme_fit() -> None:
    """What the README gives to a command loads: config, overrides and all."""
    checked = 0
    for target, arguments in python_commands((ROOT / "README.md").read_text()):
        configs = [argument for argument in arguments if argument.startswith("configs/")]
        overrides = [argument for argument in arguments if re.match(r"[a-z_][\w.]*=", argument)]
        for config in configs:
            load_config(model_of(ROOT / config), ROOT / config, overrides)
            checked += 1
        assert configs or not overrides, f"{target}: overrides of no config"
    assert checked >= 2


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("python -m sixway.relit a.npz", "sixway.relit: there is no such program"),
        ("python data_gen/make.py --out x", "data_gen/make.py: there is no such program"),
        ("python -m sixway.train configs/train/huge.yaml --run-dir x", "configs/train/huge.yaml does not exist"),
        ("python -m sixway.export runs/tiny \\\n  --sizes 512", "sixway.export: unknown option --sizes"),
        ("torchrun --nproc-per-node 2 -m sixway.train c.yaml --rundir x", "sixway.train: unknown option --rundir"),
    ],
)
def test_a_readme_that_lies_is_noticed(help_of: Callable[[str], str], line: str, fault: str) -> None:
    found = faults(f"text\n\n```bash\n# comment\n{line}\n```\n", help_of)
    assert len(found) == 1 and fault in found[0]


def test_a_readme_with_a_wrong_override_is_noticed() -> None:
    with pytest.raises(ConfigError, match="did you mean 'lr'"):
        load_config(TrainConfig, ROOT / "configs/train/tiny.yaml", ["train.lrr=1e-3"])
