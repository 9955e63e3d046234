"""Few targets, a side radar, a vehicle that stands."""

from d2d.study.guides import hard_cases
from d2d.study.guides.rows import Row


def by_name(rows: list[Row]) -> dict[str, Row]:
    return {each.name: each for each in rows}


def test_few_targets_need_to_know_the_vehicle():
    """Breaks if limits and side slip no longer help, or three radars are no better than one."""
    found = by_name(hard_cases.few_targets())
    assert found["one: as it is"].accepted < 0.3
    assert found["one: no side slip, limits"].accepted > found["one: as it is"].accepted
    assert found["three: no side slip, limits"].anees < 1.5
    assert found["three: no side slip, limits"].accepted > 0.95


def test_a_side_radar_needs_to_know_that_the_car_does_not_slip():
    """Breaks if a small side slip no longer makes the yaw rate much more accurate."""
    found = by_name(hard_cases.side_radar())
    assert found["side slip of 0.05 m/s"].rmse[2] < 0.5 * found["as it is"].rmse[2]
    assert found["side slip of 0.05 m/s"].accepted > found["as it is"].accepted
    assert found["baseline 2"].rmse[2] > 0.5 * found["as it is"].rmse[2]


def test_a_standing_vehicle_is_estimated_as_any_other():
    """Breaks if a Doppler velocity of zero is an exception."""
    found = by_name(hard_cases.standing())
    for each in found.values():
        assert each.accepted == 1.0
        assert 0.7 < each.anees < 1.4
    assert found["baseline 3"].rmse[2] < 0.5 * found["as it is"].rmse[2]
