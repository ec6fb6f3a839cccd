"""What several tests are given."""

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from compared import is_compared
from hypothesis import HealthCheck, settings

# the same examples in every run, and no deadline, which a busy machine would miss
settings.register_profile(
    "tertia",
    deadline=None,
    derandomize=True,
    max_examples=150,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("tertia")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # a file that takes long would otherwise be left for one core in the end
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
    # only if they are asked for, as to find them takes seconds in each process
    if "compared" in config.option.markexpr:
        for item in filter(is_compared, items):
            item.add_marker(pytest.mark.compared)


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a text, or lines, to a file."""

    def to_file(text: str | Iterable[str], name: str = "records.csv") -> Path:
        path = tmp_path / name
        lines = text if isinstance(text, str) else "\n".join(text) + "\n"
        path.write_text(lines, encoding="utf-8")
        return path

    return to_file
