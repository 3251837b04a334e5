/* Every query of the header, for a test that compares the bits with the library's own:
 *
 *     answers FOLDER TIER COUNT QUERIES ANSWERS
 *
 * QUERIES holds floats, columns of COUNT: one per free parameter, then wo and u. Of the first parameter one value counts. The
 * columns of ANSWERS are wi and weight; wi and jacobian; wi and jacobian of the mixture; f_cos, pdf and exact pdf at wi; and
 * f_cos once more with the last parameter bound to its first value. Inversions are printed.
 */
#include "bake.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { PARAMETERS_MAX = 24 };

/* Ends the program where something failed. */
static void require(int fine, const char *what) {
    if (!fine) {
        fprintf(stderr, "%s: %s\n", what, bake_last_error());
        exit(1);
    }
}

static void check(BakeStatus status) { require(status == BAKE_STATUS_OK, bake_status_name(status)); }

/* The bytes of a file. */
static BakeBytes slurp(const char *path) {
    BakeBytes bytes;
    long size = 0;
    void *data;
    FILE *file = fopen(path, "rb");
    require(file != NULL && fseek(file, 0, SEEK_END) == 0 && (size = ftell(file)) > 0, path);
    rewind(file);
    data = malloc((size_t)size);
    require(data != NULL && fread(data, 1, (size_t)size, file) == (size_t)size, path);
    fclose(file);
    bytes.data = data;
    bytes.length = (size_t)size;
    return bytes;
}

static BakeMaterial *load(const char *folder, const char *tier) {
    static const char *const names[3] = {"sample", "eval", "pdf"};
    BakeMaterial *material;
    BakeBytes files[3];
    int i;
    for (i = 0; i < 3; i++) {
        char path[1024];
        snprintf(path, sizeof path, "%s/%s.safetensors", folder, names[i]);
        files[i] = slurp(path);
    }
    check(bake_material_from_memory(files[0], files[1], files[2], tier, &material));
    for (i = 0; i < 3; i++) {
        free((void *)files[i].data);
    }
    return material;
}

int main(int argc, char **argv) {
    BakeMaterial *material, *bound;
    BakeColumn columns[PARAMETERS_MAX];
    BakePoints points;
    BakeUniforms u;
    BakeDirections wi;
    BakeDirectionsOut drawn;
    BakeColorsOut color;
    BakeInversions mixture, exact = {0, 0};
    BakeBytes queries;
    float bindings[PARAMETERS_MAX];
    const float *in;
    float *out, *answers;
    size_t i, n, parameters;
    FILE *file;

    require(argc == 6, "five arguments");
    n = (size_t)atol(argv[3]);
    queries = slurp(argv[4]);
    material = load(argv[1], argv[2]);
    parameters = bake_material_parameter_count(material);
    require(parameters <= PARAMETERS_MAX, "few parameters");
    require(queries.length == (parameters + 5) * n * sizeof(float), "length of the queries");
    in = queries.data;
    answers = out = malloc(26 * n * sizeof(float));
    require(out != NULL, "memory");

    for (i = 0; i < parameters; i++, in += n) {
        columns[i].data = in;
        columns[i].length = i == 0 ? 1 : n;
        bindings[i] = i + 1 == parameters ? in[0] : NAN;
    }
    points.params = columns;
    points.param_count = parameters;
    points.count = n;
    points.wo.x = in;
    points.wo.y = in + n;
    points.wo.z = in + 2 * n;
    u.u0 = in + 3 * n;
    u.u1 = in + 4 * n;

#define TAKE(triple, a, b, c) (triple.a = out, triple.b = out + n, triple.c = out + 2 * n, out += 3 * n)
    TAKE(drawn, x, y, z);
    wi.x = drawn.x;
    wi.y = drawn.y;
    wi.z = drawn.z;
    TAKE(color, r, g, b);
    check(bake_sample(material, &points, u, drawn, color));
    TAKE(drawn, x, y, z);
    check(bake_sample_jacobian(material, &points, u, drawn, out));
    out += n;
    TAKE(drawn, x, y, z);
    check(bake_sample_mixture(material, &points, u, drawn, out, &mixture));
    out += n;
    TAKE(color, r, g, b);
    check(bake_eval(material, &points, wi, color));
    check(bake_pdf(material, &points, wi, out));
    out += n;
    if (bake_material_chart_count(material) > 0) {
        check(bake_exact_pdf(material, &points, wi, out, &exact));
        out += n;
    }
    check(bake_material_bind(material, bindings, parameters, &bound));
    bake_material_free(material);
    points.param_count = bake_material_parameter_count(bound);
    TAKE(color, r, g, b);
    check(bake_eval(bound, &points, wi, color));
    bake_material_free(bound);

    printf("%lu %lu %lu %lu\n", (unsigned long)mixture.queries, (unsigned long)mixture.unconverged,
           (unsigned long)exact.queries, (unsigned long)exact.unconverged);
    file = fopen(argv[5], "wb");
    i = (size_t)(out - answers);
    require(file != NULL && fwrite(answers, sizeof(float), i, file) == i && fclose(file) == 0, argv[5]);
    free(answers);
    free((void *)queries.data);
    return 0;
}
