"""Cost of simulated flights and of their plots."""

from tertia import simulate

SCENE = simulate.set_up("middle")


def test_flights(benchmark):
    plans = simulate.routes("middle", 100, rng=1)
    benchmark.pedantic(lambda: simulate.flights(plans, wind=SCENE.wind, rng=2), rounds=3)


def test_radar_plots(benchmark):
    traffic = simulate.dense_traffic(1000, rng=1)
    benchmark.pedantic(lambda: simulate.radar_plots(traffic, [SCENE.radar], rng=2), rounds=3)
