import pytest

from experiments.studies.paper.edited import LAST, edited
from transferkit.run import EpisodeRow


@pytest.mark.parametrize(
    ("returns", "mean"),
    [([5.0, 0.0, -3.0], (5 - 10 - 10) / 3), ([-1e9] * 10 + [2.0] * LAST, 2.0), ([1.0], 1.0)],
)
def test_returns_of_0_or_less_count_as_minus_10(tmp_path, returns, mean):
    lines = [f"{k},0,{value},1,1,{k},0.0" for k, value in enumerate(returns)]
    (tmp_path / "episodes.csv").write_text("\n".join([",".join(EpisodeRow.columns()), *lines, ""]))
    assert edited(tmp_path) == pytest.approx(mean, abs=1e-3)
