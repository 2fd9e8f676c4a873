"""All plants of the benchmark, by name."""

from benchmarks.automata.literature import circuits, heat_and_water, life, maps, mechanics

__all__ = ["PLANTS"]

PLANTS = {
    plant.name: plant
    for field in (heat_and_water, mechanics, circuits, life, maps)
    for plant in field.PLANTS
}
