// Light that thin films reflect. Part of `march.wgsl`; only plans with thin films call it. Twin of `reference::thin_film`.

// Thin films in lanes (`tables::ThinFilmTable`).
struct ThinFilms {
    factor: array<vec4f, FILM_LANES>,
    exponent: array<vec4u, FILM_LANES>,
    weight: array<vec4u, FILM_LANES>,
    // With weights, the film of each component of their vectors.
    film: array<vec4u, FILM_VECTORS>,
}

@group(0) @binding(23) var<uniform> thin_films_uniform: ThinFilms;
// Components of the light that each film reflects at each of THIN_FILM_ANGLES. With weights, those of all films in one row.
@group(0) @binding(24) var<storage, read> thin_film_angles: array<vec4f>;

// Copy of the uniform, as for `march`.
var<private> thin_films: ThinFilms;

// A place in the table of angles.
struct Angle {
    low: u32,
    part: f32,
}

fn angle_at(cosine: f32) -> Angle {
    let place = clamp(cosine, 0.0, 1.0) * f32(THIN_FILM_ANGLES - 1u);
    let low = min(u32(place), THIN_FILM_ANGLES - 2u);
    return Angle(low, place - f32(low));
}

// Adds what film `i` reflects at an angle, with this shade, to coefficients, by this share.
fn add_thin_film(i: u32, angle: Angle, shade: f32, step: Step, share: Share, source: ptr<function, array<vec4f, LANES>>) {
    let first = (i * THIN_FILM_ANGLES + angle.low) * LANES;
    let factor = thin_films.factor[i / 4u][i % 4u] * shade;
    var white = 0.0;
    if (!COLOURED) {
        white = step.source[THIN_FILM_PARTS + i / 4u][i % 4u] * factor;
    }
    for (var lane = 0u; lane < LANES; lane += 1u) {
        let reflected = mix_angles(thin_film_angles[first + lane], thin_film_angles[first + LANES + lane], angle.part);
        if (COLOURED) {
            let white = step.source[THIN_FILM_PARTS + i * LANES + lane] * factor;
            (*source)[lane] = fma(reflected, white * share_in(share, lane), (*source)[lane]);
        } else {
            (*source)[lane] = fma(reflected, white * share_in(share, lane), (*source)[lane]);
        }
    }
}

// Sets the white of the components of film `i`, with this shade, by this share.
fn set_white(i: u32, shade: f32, step: Step, share: Share, white: ptr<function, array<vec4f, FILM_VECTORS>>) {
    let weight = thin_films.weight[i / 4u][i % 4u];
    let own = step.source[weight / 4u][weight % 4u] * (thin_films.factor[i / 4u][i % 4u] * shade);
    for (var vector = 0u; vector < FILM_VECTORS; vector += 1u) {
        // Weights are exact for grey absorption only, where a share is one number.
        let arriving = own * share_in(share, 0u);
        (*white)[vector] = select((*white)[vector], arriving, thin_films.film[vector] == vec4u(i));
    }
}

// Adds what all films reflect at an angle, by the white of each component, to weights.
fn add_terms(angle: Angle, white: array<vec4f, FILM_VECTORS>, source: ptr<function, array<vec4f, LANES>>) {
    let first = angle.low * FILM_VECTORS;
    for (var vector = 0u; vector < FILM_VECTORS; vector += 1u) {
        let lane = FIRST_FILM_VECTOR + vector;
        let reflected = mix_angles(thin_film_angles[first + vector], thin_film_angles[first + FILM_VECTORS + vector], angle.part);
        (*source)[lane] = fma(reflected, white[vector], (*source)[lane]);
    }
}

fn mix_angles(low: vec4f, high: vec4f, part: f32) -> vec4f {
    return fma(vec4f(part), high - low, low);
}

// Adds the light that all films reflect towards the eye from the direction `light`, of which this share arrives.
fn add_thin_films(light: vec3f, ray: Ray, step: Step, share: Share, source: ptr<function, array<vec4f, LANES>>) {
    let along = dot(step.normal, light);
    let facing = lit(along);
    if (FACING_THIN_FILMS > 0u) {
        let angle = angle_at(0.5 * (abs(along) + abs(dot(step.normal, ray.view))));
        if (FILM_WEIGHTS) {
            var white: array<vec4f, FILM_VECTORS>;
            for (var i = 0u; i < FACING_THIN_FILMS; i += 1u) {
                set_white(i, facing, step, share, &white);
            }
            add_terms(angle, white, source);
        } else {
            for (var i = 0u; i < FACING_THIN_FILMS; i += 1u) {
                add_thin_film(i, angle, facing, step, share, source);
            }
        }
    }
    if (THIN_FILMS > FACING_THIN_FILMS) {
        let halfway = unit(light + ray.view);
        var shine = lit(dot(step.normal, halfway));
        if (ONE_SIDED) {
            shine = select(0.0, shine, facing > 0.0);
        }
        let cosine = abs(dot(light, halfway));
        let angle = angle_at(cosine);
        if (FILM_WEIGHTS) {
            var white: array<vec4f, FILM_VECTORS>;
            for (var i = FACING_THIN_FILMS; i < THIN_FILMS; i += 1u) {
                set_white(i, power(shine, thin_films.exponent[i / 4u][i % 4u]), step, share, &white);
            }
            add_terms(angle, white, source);
        } else {
            for (var i = FACING_THIN_FILMS; i < THIN_FILMS; i += 1u) {
                add_thin_film(i, angle, power(shine, thin_films.exponent[i / 4u][i % 4u]), step, share, source);
            }
        }
    }
}
