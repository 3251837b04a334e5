/* Loads a baked folder, asks it for a few thousand directions at one place, and prints what they say.
 *
 *     sample FOLDER [TIER]
 */
#include "bake.h"

#include <stdio.h>
#include <stdlib.h>

enum { COUNT = 4096, PARAMETERS_MAX = 24 };

/* Structures of arrays: a column per component. */
static float wo[3][COUNT], u[2][COUNT], wi[3][COUNT], weight[3][COUNT], f_cos[3][COUNT], pdf[COUNT];

/* Ends the program where a call failed. */
static void check(BakeStatus status) {
    if (status != BAKE_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", bake_status_name(status), bake_last_error());
        exit(1);
    }
}

/* The bits of i mirrored at the point: with i / COUNT the points of Hammersley. */
static float mirrored(unsigned i) {
    float value = 0.0f, digit = 0.5f;
    for (; i != 0; i >>= 1, digit *= 0.5f) {
        value += (float)(i & 1u) * digit;
    }
    return value;
}

/* Loads a folder, and binds every parameter that it leaves free to the middle of its range. */
static BakeMaterial *load(const char *folder, const char *tier) {
    BakeMaterial *free_material, *bound;
    float values[PARAMETERS_MAX];
    size_t i, count;
    check(bake_material_load(folder, tier, &free_material));
    count = bake_material_parameter_count(free_material);
    if (count > PARAMETERS_MAX) {
        fprintf(stderr, "%s leaves too many parameters free\n", folder);
        exit(1);
    }
    printf("tier %s\n", bake_material_tier(free_material));
    for (i = 0; i < count; i++) {
        BakeParameter parameter;
        check(bake_material_parameter(free_material, i, &parameter));
        values[i] = 0.5f * (parameter.min + parameter.max);
        printf("parameter %s %g %g\n", parameter.name, parameter.min, parameter.max);
    }
    check(bake_material_bind(free_material, values, count, &bound));
    /* The bound one keeps what it needs. */
    bake_material_free(free_material);
    return bound;
}

int main(int argc, char **argv) {
    BakeMaterial *material;
    BakePoints points = {0};
    const BakeUniforms uniforms = {u[0], u[1]};
    const BakeDirections directions = {wi[0], wi[1], wi[2]};
    const BakeDirectionsOut drawn = {wi[0], wi[1], wi[2]};
    const BakeColorsOut weights = {weight[0], weight[1], weight[2]};
    const BakeColorsOut values = {f_cos[0], f_cos[1], f_cos[2]};
    double albedo[3] = {0.0, 0.0, 0.0};
    int i, channel, valid = 0;

    if (argc < 2) {
        fprintf(stderr, "usage: %s FOLDER [TIER]\n", argv[0]);
        return 2;
    }
    if (bake_abi_version() != BAKE_ABI_VERSION) {
        fprintf(stderr, "the library has interface %u, not %u\n", bake_abi_version(), BAKE_ABI_VERSION);
        return 1;
    }
    material = load(argv[1], argc > 2 ? argv[2] : NULL);

    for (i = 0; i < COUNT; i++) {
        /* Sixty degrees from the normal. */
        wo[0][i] = 0.8660254f;
        wo[1][i] = 0.0f;
        wo[2][i] = 0.5f;
        u[0][i] = ((float)i + 0.5f) / COUNT;
        u[1][i] = mirrored((unsigned)i);
    }
    points.wo.x = wo[0];
    points.wo.y = wo[1];
    points.wo.z = wo[2];
    points.count = COUNT;

    /* The mean weight is the albedo. */
    check(bake_sample(material, &points, uniforms, drawn, weights));
    for (i = 0; i < COUNT; i++) {
        valid += weight[0][i] + weight[1][i] + weight[2][i] > 0.0f;
        for (channel = 0; channel < 3; channel++) {
            albedo[channel] += weight[channel][i] / COUNT;
        }
    }
    printf("albedo %.6f %.6f %.6f\n", albedo[0], albedo[1], albedo[2]);
    printf("valid %.6f\n", (double)valid / COUNT);

    /* What was drawn is read again: other arrays may hold any directions. */
    check(bake_eval(material, &points, directions, values));
    check(bake_pdf(material, &points, directions, pdf));
    for (i = 0; i < COUNT; i += COUNT / 4) {
        printf("wi %.9g %.9g %.9g f_cos %.9g %.9g %.9g pdf %.9g\n", wi[0][i], wi[1][i], wi[2][i],
               f_cos[0][i], f_cos[1][i], f_cos[2][i], pdf[i]);
    }
    bake_material_free(material);
    return 0;
}
