import json
import shutil

import pytest

import core_zoo
from transferkit import load_core
from transferkit.cli.main import main
from transferkit.errors import ArtifactError
from transferkit.reading import sealed
from transferkit.zoo import find
from transferkit.zoo.catalog import list_cards
from transferkit.zoo.find import find_cores, play_found

TARGET = "dm_control/cartpole-balance-v0"


@pytest.fixture
def own_zoo(tmp_path, monkeypatch):
    """A zoo of one's own before the installed one; copies a core into it with another name and changes its card."""
    monkeypatch.setenv("TRANSFERKIT_ZOO", str(tmp_path / "zoo"))

    def copied(folder, change=lambda card: None):
        path = tmp_path / "zoo" / folder
        shutil.copytree(f"{core_zoo.__path__[0]}/inverted-pendulum-v2", path)
        card = json.loads((path / "card.json").read_text())
        card["id"] = folder
        change(card)
        (path / "card.json").write_text(json.dumps(sealed({key: value for key, value in card.items() if key != "digest"})))
        return path

    return copied


@pytest.mark.parametrize(
    ("place", "value"),
    [(("action", 0, "authority"), 1e20), (("joints", 1, "anchor"), [1e308] * 3), (("joints", 1, "length"), 1e200)],
)
def test_a_core_whose_numbers_no_robot_has_is_named_and_the_others_are_found(own_zoo, place, value, capsys):
    def change(card):
        kind, k, name = place
        card["source"][kind][k][name] = value

    own_zoo("odd-v1", change)
    found, errors = find_cores(TARGET)
    assert "inverted-pendulum-v2" in [one.core for one in found]
    assert all("odd-v1: InvertedPendulum-v5 cannot be matched with" in str(error) for error in errors)
    assert len(errors) == ("odd-v1" not in [one.core for one in found])
    main(["match", "odd-v1", TARGET])
    assert "Traceback" not in capsys.readouterr().err


def test_a_core_has_the_name_of_its_folder(own_zoo):
    own_zoo("renamed-v1", lambda card: card.update(id="hopper-v1"))
    cards, errors = list_cards()
    assert "the folder renamed-v1 holds the core hopper-v1; call it hopper-v1" in str(errors[0])
    assert [card.source.env_id for card in cards if card.id == "hopper-v1"] == ["Hopper-v5"]
    with pytest.raises(ArtifactError, match="holds the core hopper-v1"):
        load_core("renamed-v1")


def test_what_cannot_be_played_or_verified_costs_nothing_of_the_rest(own_zoo, monkeypatch, capsys):
    monkeypatch.setattr(find, "EPISODES", 1)
    weights = own_zoo("broken-v1") / "core.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1] + b"x")
    found = [one for one in find_cores(TARGET)[0] if one.core in ("broken-v1", "inverted-pendulum-v2")]
    played, errors = play_found(found, TARGET)
    assert list(played) == ["inverted-pendulum-v2"]
    assert "broken-v1" in str(errors[0])
    assert main(["zoo", "verify", "broken-v1", "inverted-pendulum-v2"]) == 2
    captured = capsys.readouterr()
    assert "inverted-pendulum-v2: hashes, schema and probe outputs fit" in captured.out
    assert "not verified: " in captured.err
    assert "broken-v1" in captured.err
