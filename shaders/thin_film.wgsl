// Light that thin films reflect. Part of `march.wgsl`; only plans with thin films call it. Twin of `reference::thin_film`.

// Thin films in lanes (`tables::FilmTable`).
struct Films {
    factor: array<vec4f, FILM_LANES>,
    exponent: array<vec4u, FILM_LANES>,
    weight: array<vec4u, FILM_LANES>,
}

@group(0) @binding(23) var<uniform> films_uniform: Films;
// Components of the light that each film reflects at each of FILM_ANGLES.
@group(0) @binding(24) var<storage, read> film_angles: array<vec4f>;

// Copy of the uniform, as for `march`.
var<private> films: Films;

// Copies the uniform, once per invocation.
fn read_films() {
    films = films_uniform;
}

// Adds what film `i` reflects at a cosine, with this shade.
fn add_film(i: u32, cosine: f32, shade: f32, step: Step, source: ptr<function, array<vec4f, LANES>>) {
    let place = clamp(cosine, 0.0, 1.0) * f32(FILM_ANGLES - 1u);
    let low = min(u32(place), FILM_ANGLES - 2u);
    let part = place - f32(low);
    let first = (i * FILM_ANGLES + low) * LANES;
    let factor = films.factor[i / 4u][i % 4u] * shade;
    var white = 0.0;
    if (FILM_WEIGHTS) {
        let weight = films.weight[i / 4u][i % 4u];
        white = step.source[weight / 4u][weight % 4u] * factor;
    } else if (!COLOURED) {
        white = step.source[FILM_PARTS + i / 4u][i % 4u] * factor;
    }
    for (var lane = 0u; lane < LANES; lane += 1u) {
        let reflected = mix_angles(film_angles[first + lane], film_angles[first + LANES + lane], part);
        if (COLOURED) {
            (*source)[lane] = fma(reflected, step.source[FILM_PARTS + i * LANES + lane] * factor, (*source)[lane]);
        } else {
            (*source)[lane] = fma(reflected, vec4f(white), (*source)[lane]);
        }
    }
}

fn mix_angles(low: vec4f, high: vec4f, part: f32) -> vec4f {
    return fma(vec4f(part), high - low, low);
}

// Adds the light that all films reflect towards the eye from the direction `light`, of which the fraction `reached` arrives.
fn add_films(light: vec3f, ray: Ray, step: Step, reached: f32, source: ptr<function, array<vec4f, LANES>>) {
    let along = dot(step.normal, light);
    let facing = lit(along);
    if (FACING_FILMS > 0u) {
        let cosine = 0.5 * (abs(along) + abs(dot(step.normal, ray.view)));
        for (var i = 0u; i < FACING_FILMS; i += 1u) {
            add_film(i, cosine, facing * reached, step, source);
        }
    }
    if (FILMS > FACING_FILMS) {
        let halfway = unit(light + ray.view);
        var shine = lit(dot(step.normal, halfway));
        if (ONE_SIDED) {
            shine = select(0.0, shine, facing > 0.0);
        }
        let cosine = abs(dot(light, halfway));
        for (var i = FACING_FILMS; i < FILMS; i += 1u) {
            add_film(i, cosine, power(shine, films.exponent[i / 4u][i % 4u]) * reached, step, source);
        }
    }
}
