/* The C interface of baked materials. Made by cbindgen from runtime/capi/src: change it there.
 *
 * `wo` points to the camera, `wi` to the light, both away from the surface: unit vectors of the shading frame, z is the
 * normal. `f_cos` is f(wo, wi) cos(theta_i) in 1/sr, `pdf` is per solid angle of `wi`, `weight` is f_cos / pdf, and u are
 * two uniform random numbers.
 *
 * Batches are structures of arrays. `count` in BakePoints is the length of every array but the columns of parameters,
 * which say their own. Arrays may be null where the count is 0. Outputs may share memory with no other array of the call;
 * a call that is refused writes nothing.
 *
 * Every function but bake_material_free may be called from any number of threads at once, also on one material. Queries
 * run on the calling thread alone.
 */

#ifndef BAKE_H
#define BAKE_H

#include <stddef.h>
#include <stdint.h>

/**
 * Version of this interface. It changes whenever a program built with an older header would not run any more.
 */
#define BAKE_ABI_VERSION 1

/**
 * How a call ended.
 */
typedef enum {
    /**
     * It did what it says.
     */
    BAKE_STATUS_OK = 0,
    /**
     * A pointer is null that must not be.
     */
    BAKE_STATUS_NULL_POINTER = 1,
    /**
     * The number of parameters or the length of a column is not what material and batch ask for.
     */
    BAKE_STATUS_WRONG_LENGTH = 2,
    /**
     * An argument makes no sense: a name, an index, a number that is not finite, an array that is misaligned or overlaps
     * another one.
     */
    BAKE_STATUS_INVALID_ARGUMENT = 3,
    /**
     * A file could not be read.
     */
    BAKE_STATUS_IO = 4,
    /**
     * A file is not a network that this library can run, or not one of the same material as the others.
     */
    BAKE_STATUS_NETWORK = 5,
    /**
     * This processor lacks the SIMD tier.
     */
    BAKE_STATUS_TIER = 6,
    /**
     * An error of this library.
     */
    BAKE_STATUS_INTERNAL = 7,
} BakeStatus;

/**
 * A baked material, ready to be asked. It does not change: any number of threads may ask it at once.
 */
typedef struct BakeMaterial BakeMaterial;

/**
 * The bytes of a file.
 */
typedef struct {
    /**
     * The first of them; any alignment.
     */
    const void *data;
    /**
     * Their number.
     */
    size_t length;
} BakeBytes;

/**
 * A parameter that a material leaves free.
 */
typedef struct {
    /**
     * Its name, e.g. "alpha[0]"; lives as long as the material.
     */
    const char *name;
    /**
     * Smallest value that the networks learned.
     */
    float min;
    /**
     * Largest value that the networks learned.
     */
    float max;
} BakeParameter;

/**
 * Values of one free parameter.
 */
typedef struct {
    /**
     * One value per query, or a single one for all of them. Values outside of the parameter's range are taken as they are.
     */
    const float *data;
    /**
     * Their number: that of the queries, or 1.
     */
    size_t length;
} BakeColumn;

/**
 * Directions to read: a column per component, count floats each.
 */
typedef struct {
    /**
     * Along the tangent.
     */
    const float *x;
    /**
     * Along the bitangent.
     */
    const float *y;
    /**
     * Along the normal.
     */
    const float *z;
} BakeDirections;

/**
 * The shading points of a batch.
 */
typedef struct {
    /**
     * A column for each parameter that the material leaves free, in their order. May be null where there is none.
     */
    const BakeColumn *params;
    /**
     * Number of columns: bake_material_parameter_count.
     */
    size_t param_count;
    /**
     * Directions to the camera.
     */
    BakeDirections wo;
    /**
     * Number of queries; results do not depend on how queries are batched.
     */
    size_t count;
} BakePoints;

/**
 * Uniform random numbers to read, in [0, 1): two columns, count floats each.
 */
typedef struct {
    /**
     * The first of each query.
     */
    const float *u0;
    /**
     * The second of each query.
     */
    const float *u1;
} BakeUniforms;

/**
 * Directions to write: a column per component, count floats each.
 */
typedef struct {
    /**
     * Along the tangent.
     */
    float *x;
    /**
     * Along the bitangent.
     */
    float *y;
    /**
     * Along the normal.
     */
    float *z;
} BakeDirectionsOut;

/**
 * Linear RGB to write: a column per channel, count floats each.
 */
typedef struct {
    /**
     * Red.
     */
    float *r;
    /**
     * Green.
     */
    float *g;
    /**
     * Blue.
     */
    float *b;
} BakeColorsOut;

/**
 * How many inversions of the map a batch took, and how many failed.
 */
typedef struct {
    /**
     * Charts times queries whose directions are finite and above the horizon.
     */
    uint64_t queries;
    /**
     * Those that did not converge; there the density of the chart's frame stands in.
     */
    uint64_t unconverged;
} BakeInversions;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Version of the interface that the library has: a program asks for it once and goes on if it is BAKE_ABI_VERSION.
 */
uint32_t bake_abi_version(void);

/**
 * The name of a status in English, e.g. "wrong length"; "unknown status" for any other number. Never null, lives forever.
 */
const char *bake_status_name(int status);

/**
 * What was wrong with the calling thread's last call that failed, in one line that names the argument or the file; empty
 * before the first. Never null; valid until the thread's next call that fails, or its end.
 */
const char *bake_last_error(void);

/**
 * Loads the networks of a baked folder: sample.safetensors, eval.safetensors and pdf.safetensors.
 *
 * tier names the instructions to use: "scalar", "portable", "avx2" or "avx512"; null for the environment variable
 * BAKE_TIER, or else the fastest that this processor has. *out becomes the material, to be freed with bake_material_free,
 * or null where the call fails.
 *
 * # Errors
 * BAKE_STATUS_NULL_POINTER; BAKE_STATUS_IO for a file that cannot be read; BAKE_STATUS_NETWORK for one that is no network
 * of this format, or not one of the same material as the others; BAKE_STATUS_TIER for a tier that this processor lacks,
 * BAKE_STATUS_INVALID_ARGUMENT for one that there is not.
 *
 * # Safety
 * Strings end with NUL, and out may be written.
 */
BakeStatus bake_material_load(const char *folder,
                              const char *tier,
                              BakeMaterial **out);

/**
 * Loads a material from the bytes of its three files, for programs that have their own file system. The bytes are copied.
 *
 * tier and *out are as in bake_material_load.
 *
 * # Errors
 * As of bake_material_load, without BAKE_STATUS_IO.
 *
 * # Safety
 * There are as many bytes as said, strings end with NUL, and out may be written.
 */
BakeStatus bake_material_from_memory(BakeBytes sample,
                                     BakeBytes eval,
                                     BakeBytes pdf,
                                     const char *tier,
                                     BakeMaterial **out);

/**
 * The same material with values for some of its free parameters, which then cost nothing any more; NaN leaves a parameter
 * free. values has one number per free parameter, in their order. They may lie outside of the parameter's range, where
 * the networks guess.
 *
 * *out becomes the bound material, to be freed with bake_material_free, or null where the call fails. It shares its
 * weights with the first one; each may be freed before the other.
 *
 * # Errors
 * BAKE_STATUS_NULL_POINTER; BAKE_STATUS_WRONG_LENGTH when count is not bake_material_parameter_count;
 * BAKE_STATUS_INVALID_ARGUMENT for an infinite value.
 *
 * # Safety
 * The material lives, values has count numbers, and out may be written.
 */
BakeStatus bake_material_bind(const BakeMaterial *material,
                              const float *values,
                              size_t count,
                              BakeMaterial **out);

/**
 * Frees a material. Null is none; no other call may use it any more.
 *
 * # Safety
 * The material is null or from this library, was not freed yet, and no other thread is asking it.
 */
void bake_material_free(BakeMaterial *material);

/**
 * The number of parameters that a material leaves free; 0 for null.
 *
 * # Safety
 * The material is null or lives.
 */
size_t bake_material_parameter_count(const BakeMaterial *material);

/**
 * Describes the free parameter number index, from 0 on: *out becomes its name and range.
 *
 * # Errors
 * BAKE_STATUS_NULL_POINTER; BAKE_STATUS_INVALID_ARGUMENT for an index that there is not.
 *
 * # Safety
 * The material lives, and out may be written.
 */
BakeStatus bake_material_parameter(const BakeMaterial *material, size_t index, BakeParameter *out);

/**
 * The name of the instructions that a material uses, as in bake_material_load; lives as long as the material. Null for
 * null.
 *
 * # Safety
 * The material is null or lives.
 */
const char *bake_material_tier(const BakeMaterial *material);

/**
 * The number of charts that directions are drawn in: 1 or 2, or 0 for networks of the paper's preset, which draw on the
 * disk, and for null.
 *
 * # Safety
 * The material is null or lives.
 */
size_t bake_material_chart_count(const BakeMaterial *material);

/**
 * Draws directions with the weight that the sampling network learned: the cheapest estimator, biased by what the model
 * card says.
 *
 * Reads u. Writes wi, and weight = f_cos / pdf (RGB, dimensionless, not negative). A query whose wo is not finite or not
 * above the horizon, or one of whose parameters is not finite, gets wi = (0, 0, 1) and zeros; everything written is finite.
 * A thread's first queries allocate, and its first on wider networks; no others do.
 *
 * # Errors
 * BAKE_STATUS_NULL_POINTER, BAKE_STATUS_WRONG_LENGTH for the parameters' columns or a count beyond all memory, and
 * BAKE_STATUS_INVALID_ARGUMENT for arrays that are misaligned or overlap; bake_last_error names the array.
 *
 * # Safety
 * The material lives, and all arrays have as many elements as points say.
 */
BakeStatus bake_sample(const BakeMaterial *material,
                       const BakePoints *points,
                       BakeUniforms u,
                       BakeDirectionsOut wi,
                       BakeColorsOut weight);

/**
 * Draws the same directions as bake_sample, with the number that makes any f_cos an unbiased weight: f_cos * jacobian,
 * where f_cos is the reference's own, or bake_eval's.
 *
 * Reads u. Writes wi, and jacobian (sr, signed). With one chart it is the determinant of u -> wi, and 1 / |jacobian| is the
 * density of wi where the map does not fold; with two it is that of the drawn chart times its share in the density that
 * the pdf network learned. About three passes of the sampling network. Invalid queries and allocation as in bake_sample.
 *
 * # Errors
 * As of bake_sample.
 *
 * # Safety
 * As of bake_sample.
 */
BakeStatus bake_sample_jacobian(const BakeMaterial *material,
                                const BakePoints *points,
                                BakeUniforms u,
                                BakeDirectionsOut wi,
                                float *jacobian);

/**
 * Like bake_sample_jacobian, with exact densities in the place of the learned ones: less variance with two charts, whose
 * maps are inverted at every direction; with fewer nothing is inverted and both give the same.
 *
 * Reads u. Writes wi, jacobian (sr, signed) and, unless it is null, inversions. Invalid queries and allocation as in
 * bake_sample.
 *
 * # Errors
 * As of bake_sample.
 *
 * # Safety
 * As of bake_sample.
 */
BakeStatus bake_sample_mixture(const BakeMaterial *material,
                               const BakePoints *points,
                               BakeUniforms u,
                               BakeDirectionsOut wi,
                               float *jacobian,
                               BakeInversions *inversions);

/**
 * Evaluates the material: f_cos, RGB in 1/sr, as the evaluation network learned it.
 *
 * Reads wi. Writes f_cos. A query whose wo or wi is not finite or not above the horizon, or one of whose parameters is not
 * finite, gets zeros; everything written is finite. Allocation as in bake_sample.
 *
 * # Errors
 * As of bake_sample.
 *
 * # Safety
 * As of bake_sample.
 */
BakeStatus bake_eval(const BakeMaterial *material,
                     const BakePoints *points,
                     BakeDirections wi,
                     BakeColorsOut f_cos);

/**
 * The density of wi among what bake_sample draws, 1/sr, as the pdf network learned it: cheap, and made for weights of
 * multiple importance sampling. It is only near the density, so never divide by it.
 *
 * Reads wi. Writes pdf. Invalid queries and allocation as in bake_eval.
 *
 * # Errors
 * As of bake_sample.
 *
 * # Safety
 * As of bake_sample.
 */
BakeStatus bake_pdf(const BakeMaterial *material,
                    const BakePoints *points,
                    BakeDirections wi,
                    float *pdf);

/**
 * The density of wi among what bake_sample draws, 1/sr, by inverting the map, which costs several passes of the sampling
 * network; with two charts the mixture of both by their shares.
 *
 * Reads wi. Writes pdf and, unless it is null, inversions. Where the map folds it is the density of one of its branches,
 * where an inversion does not converge that of the chart's frame alone. Invalid queries and allocation as in bake_eval.
 *
 * # Errors
 * As of bake_sample; also BAKE_STATUS_INVALID_ARGUMENT where bake_material_chart_count is 0, for only maps of charts are
 * sure to have an inverse.
 *
 * # Safety
 * As of bake_sample.
 */
BakeStatus bake_exact_pdf(const BakeMaterial *material,
                          const BakePoints *points,
                          BakeDirections wi,
                          float *pdf,
                          BakeInversions *inversions);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* BAKE_H */
