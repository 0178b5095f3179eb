/* Passes over all pixels of an image, bit-identical to numpy's in core/image/pyramid.py, core/image/source_image.py
   and core/blender/read/scene_picture.py. */

#include <stdatomic.h>

#include "kiriko.h"

#define MOST_LIGHT 1e30 /* of a display pixel, as in core/image/source_image.py */

/* Halve a picture of even sides by means: pairs of rows, then of columns, as in pyramid.py. */
KIRIKO_API void kiriko_halve(const Level *from, float *to) {
    for (int64_t y = 0; y < from->height / 2; y++) {
        const float *upper = from->pixels + 2 * y * from->stride, *lower = upper + from->stride;
        for (int64_t x = 0; x < from->width / 2; x++, upper += 8, lower += 8, to += 4)
            for (int channel = 0; channel < 4; channel++) {
                float left = 0.5f * (upper[channel] + lower[channel]);
                float right = 0.5f * (upper[channel + 4] + lower[channel + 4]);
                to[channel] = 0.5f * (left + right);
            }
    }
}

typedef struct {
    const Level *level;
    const float *table;
    int64_t has_coverage, is_straight;
    atomic_int is_broken;
} Decoding;

static void decode_rows(void *context, int64_t first, int64_t last) {
    Decoding *decoding = context;
    for (int64_t y = first; y < last; y++) {
        float *pixel = (float *)decoding->level->pixels + y * decoding->level->stride;
        for (int64_t x = 0; x < decoding->level->width; x++, pixel += 4) {
            float off = 0; /* NaN for a value that is not finite */
            for (int channel = 0; channel < 4; channel++) off += pixel[channel] - pixel[channel];
            if (off != 0) {
                atomic_store(&decoding->is_broken, 1);
                return;
            }
            if (!decoding->has_coverage) pixel[3] = 1;
            for (int channel = 0; channel < 3; channel++) {
                if (decoding->table)
                    pixel[channel] = decoding->table[(int)(clip(pixel[channel], 0, 1) * 255 + 0.5)];
                if (decoding->is_straight) pixel[channel] *= pixel[3];
            }
        }
    }
}

/* Decode the pixels of a picture in place, as in core/blender/read/scene_picture.py; 0 if some are not finite. */
KIRIKO_API int64_t kiriko_decode(const Level *picture, const float *table, int64_t has_coverage, int64_t is_straight,
                                 int64_t n_threads) {
    Decoding decoding = {picture, table, has_coverage, is_straight, 0};
    share_out(decode_rows, &decoding, picture->height, 64, n_threads < 1 ? 1 : n_threads);
    return !atomic_load(&decoding.is_broken);
}

typedef struct {
    const double *total, *weight;
    const uint8_t *is_covered;
    float *image;
    int64_t n_pixels;
} Finish;

static void finish_pixels(void *context, int64_t first, int64_t last) {
    const Finish *f = context;
    for (int64_t i = first; i < last; i++)
        for (int channel = 0; channel < 3; channel++) {
            double sum = f->total[channel * f->n_pixels + i];
            double light = f->is_covered[i] ? clip(sum / f->weight[i], -MOST_LIGHT, MOST_LIGHT) : 0;
            f->image[3 * i + channel] = (float)light;
        }
}

/* The image (n_pixels, 3) from sums (3, n_pixels) over the shares of each pixel, and their weight. */
KIRIKO_API void kiriko_finish(const double *total, const double *weight, const uint8_t *is_covered, float *image,
                              int64_t n_pixels, int64_t n_threads) {
    Finish finish = {total, weight, is_covered, image, n_pixels};
    share_out(finish_pixels, &finish, n_pixels, 1 << 16, n_threads < 1 ? 1 : n_threads);
}
