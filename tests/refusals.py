"""What a model's refusal may name: lights that an equation does not know or that do not shine, a
cone that turns too fast, the scattering that would be left out, a lattice without end, a phase
function that is too sharp."""

LIMITS = (
    "knows only lights of the kinds",
    "of strength 0",
    "number of lights is 0",
    "the cone toward it turns too fast",
    "toward a point light reach",
    "of the light's scatterings would be left out",
    "the light's lattice would be",
    "knows media of g from",
)
