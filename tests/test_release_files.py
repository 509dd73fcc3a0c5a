"""Files for a release, in agreement with the code: the paper and the conda recipe."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
# Packages that conda-forge has under another name.
CONDA_NAMES = {"lazy-loader": "lazy_loader", "matplotlib": "matplotlib-base"}


def test_the_recipe_asks_for_what_the_package_asks_for() -> None:
    text = (ROOT / "recipe" / "recipe.yaml").read_text("utf-8")
    recipe = yaml.safe_load(text)
    extras = PROJECT["optional-dependencies"]
    wanted = [*PROJECT["dependencies"], *extras["cli"], *extras["report"], *extras["study"], *extras["panel"]]
    parts = [re.fullmatch(r"([\w-]+)>=([\w.]+)", one) for one in wanted if not one.startswith("stickslip[")]
    said = {f"{CONDA_NAMES.get(one[1], one[1])} >={one[2]}" for one in parts if one}
    assert len(said) == len(parts)
    assert set(recipe["requirements"]["run"]) == {"python", *said}
    assert recipe["about"]["summary"] == PROJECT["description"]
    assert recipe["about"]["license"] == PROJECT["license"]
    assert recipe["about"]["license_file"] == PROJECT["license-files"]
    assert recipe["source"]["url"].startswith("https://pypi.org/packages/source/s/stickslip/")


def test_the_paper_has_its_length_sections_and_references() -> None:
    text = (ROOT / "paper.md").read_text("utf-8")
    _, head, body = text.split("---\n", 2)
    assert yaml.safe_load(head).keys() >= {"title", "tags", "authors", "affiliations", "date", "bibliography"}
    words = re.findall(r"\w[\w'.-]*", body)
    assert 250 <= len(words) <= 1000
    sections = re.findall(r"^# (.+)$", body, re.MULTILINE)
    wanted = {"Summary", "Statement of need", "State of the field", "AI usage disclosure", "References"}
    assert wanted <= set(sections)
    cited = set(re.findall(r"@(\w+)", body))
    known = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper.bib").read_text("utf-8"), re.MULTILINE))
    assert cited == known


def test_the_numbers_of_the_paper_are_those_of_the_pages() -> None:
    paper = " ".join((ROOT / "paper.md").read_text("utf-8").split())
    tools = (ROOT / "docs" / "benchmarks" / "other-tools.md").read_text("utf-8")
    accuracy = (ROOT / "docs" / "accuracy.md").read_text("utf-8")
    peer = re.search(r"MuJoCo, RK4 \| [^|]+ \| [^;]+; (\S+ µm) \| [^;]+; (\S+ s) \|", tools)
    ours = re.search(r"\| stickslip \| [^|]+ \| [^;]+; [^;]+; (\S+ nm) \| [^;]+; [^;]+; (\S+ ms) \|", tools)
    assert peer is not None
    assert ours is not None
    assert f"an error of {peer[1]} took {peer[2]} of CPU time" in paper
    assert f"needed {ours[2]} for {ours[1]}" in paper
    worst = re.search(r"below (\S+ nm) for 99 %, above 3 nm for \d of (\S+) \|", accuracy)
    assert worst is not None
    assert f"Of {worst[2]} random actuators" in paper
    assert f"errors below {worst[1]}" in paper
    campaigns = next(line for line in accuracy.splitlines() if "95 % intervals of a campaign" in line)
    shares = sorted(map(float, re.findall(r"([\d.]+) % \(", campaigns)))
    assert f"in {shares[0]} to {shares[-1]} % of the cases" in paper


def test_pages_at_the_top_link_to_what_is_there() -> None:
    for page in ROOT.glob("*.md"):
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text("utf-8")):
            path, _, anchor = link.partition("#")
            if re.match(r"[a-z]+:", link):
                continue
            target = ROOT / path if path else page
            assert target.exists(), f"{page.name}: {link}"
            headings = re.findall(r"^#+ (.+)$", target.read_text("utf-8"), re.MULTILINE) if anchor else []
            assert not anchor or anchor in {one.lower().replace(" ", "-") for one in headings}, link
