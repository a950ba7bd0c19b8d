/* EXR files against OpenEXR's own C library: what it writes we read, what we write it reads, bit
   for bit. Build: cc test_openexr.c $(pkg-config --cflags --libs OpenEXR) -lm */
#define _XOPEN_SOURCE 700 /* mkdtemp */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#ifdef __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpedantic"
#endif
#include <openexr.h>
#ifdef __GNUC__
#pragma GCC diagnostic pop
#endif
#include <unistd.h>

static char directory[64], path[128];
static uint64_t random_state = 7;
static uint32_t random_bits(void) {
    random_state += 0x9e3779b97f4a7c15ull;
    return (uint32_t)(itn__mix64(random_state) >> 32);
}

/* Channels of the files that OpenEXR writes, in the order it will sort them. */
static const char *const channel_names[] = {"A", "Variance.Y", "Y",
                                            "d_a_quite_long_item_name_with_sigma_t.Y", "z"};
static const exr_pixel_type_t channel_types[] = {EXR_PIXEL_HALF, EXR_PIXEL_FLOAT, EXR_PIXEL_UINT,
                                                 EXR_PIXEL_FLOAT, EXR_PIXEL_HALF};
enum { CHANNELS = 5 };

/* The stored number of a pixel: smooth (so that compression bites), noisy, or of any bits. */
static uint32_t stored_value(int channel, int x, int y, int kind) {
    uint32_t noise = (uint32_t)itn__mix64((uint64_t)((channel * 1000 + y) * 1000 + x));
    float smooth = (float)(x / 4 + y) * .25f + (float)channel;
    uint32_t bits;
    memcpy(&bits, &smooth, 4);
    if (kind == 1) bits = noise;
    if (kind == 2) bits = noise % 16 ? 0 : noise;
    if (channel_types[channel] == EXR_PIXEL_HALF)
        return (kind ? bits : (uint32_t)(x / 4 + y)) & 0xffff;
    return bits;
}

/* What we must make of it; halves by their definition. */
static float expected_value(int channel, uint32_t stored) {
    float value;
    int exponent = (int)(stored >> 10 & 31), mantissa = (int)(stored & 1023);
    if (channel_types[channel] == EXR_PIXEL_UINT) return (float)stored;
    if (channel_types[channel] == EXR_PIXEL_HALF) {
        value = exponent == 31 ? (mantissa ? NAN : INFINITY)
                : exponent     ? ldexpf((float)(1024 + mantissa), exponent - 25)
                               : ldexpf((float)mantissa, -24);
        return stored & 0x8000 ? -value : value;
    }
    memcpy(&value, &stored, 4);
    return value;
}

static int same_value(int channel, float a, float b) {
    if (channel_types[channel] != EXR_PIXEL_FLOAT && a != a && b != b) return 1;
    return !memcmp(&a, &b, 4);
}

/* Writes a file with OpenEXR; returns whether it worked. */
static int openexr_write(int width, int height, int x0, int y0, exr_compression_t compression,
                         int decreasing, int kind) {
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t file = NULL;
    exr_encode_pipeline_t encoder;
    exr_chunk_info_t chunk;
    exr_attr_box2i_t window;
    exr_attr_v2f_t centre;
    int part, c, lines = 1, i, ok, blocks, started = 0;
    uint8_t *pixels = NULL;
    memset(&centre, 0, sizeof centre);
    window.min.x = x0, window.min.y = y0, window.max.x = x0 + width - 1,
    window.max.y = y0 + height - 1;
    ok = exr_start_write(&file, path, EXR_WRITE_FILE_DIRECTLY, &init) == EXR_ERR_SUCCESS;
    ok = ok && !exr_set_longname_support(file, 1);
    ok = ok && !exr_add_part(file, "p", EXR_STORAGE_SCANLINE, &part);
    ok = ok && !exr_initialize_required_attr(file, part, &window, &window, 1, &centre, 1,
                                             decreasing ? EXR_LINEORDER_DECREASING_Y
                                                        : EXR_LINEORDER_INCREASING_Y,
                                             compression);
    for (c = 0; c < CHANNELS; c++)
        ok = ok && !exr_add_channel(file, part, channel_names[(c + 2) % CHANNELS],
                                    channel_types[(c + 2) % CHANNELS],
                                    EXR_PERCEPTUALLY_LINEAR, 1, 1);
    ok = ok && !exr_write_header(file);
    ok = ok && !exr_get_scanlines_per_chunk(file, part, &lines);
    blocks = (height + lines - 1) / lines;
    for (i = 0; i < blocks && ok; i++) {
        int first = i * lines, k, x, y; /* the library wants them in this order, always */
        ok = !exr_write_scanline_chunk_info(file, part, y0 + first, &chunk);
        ok = ok && (started ? !exr_encoding_update(file, part, &chunk, &encoder)
                            : !exr_encoding_initialize(file, part, &chunk, &encoder));
        pixels = (uint8_t *)calloc((size_t)chunk.unpacked_size + 1, 1);
        for (k = 0; k < encoder.channel_count; k++) {
            exr_coding_channel_info_t *channel = encoder.channels + k;
            uint8_t *at = pixels;
            int before;
            for (c = 0; strcmp(channel->channel_name, channel_names[c]);) c++;
            for (before = 0; before < c; before++)
                at += (channel_types[before] == EXR_PIXEL_HALF ? 2 : 4) * width * chunk.height;
            channel->encode_from_ptr = at;
            channel->user_bytes_per_element = channel->bytes_per_element;
            channel->user_data_type = channel->data_type;
            channel->user_pixel_stride = channel->bytes_per_element;
            channel->user_line_stride = channel->bytes_per_element * width;
            for (y = 0; y < chunk.height; y++)
                for (x = 0; x < width; x++, at += channel->bytes_per_element) {
                    uint32_t stored = stored_value(c, x, first + y, kind);
                    uint16_t half = (uint16_t)stored;
                    if (channel->bytes_per_element == 2)
                        memcpy(at, &half, 2);
                    else
                        memcpy(at, &stored, 4);
                }
        }
        ok = ok && (started || !exr_encoding_choose_default_routines(file, part, &encoder));
        ok = ok && !exr_encoding_run(file, part, &encoder);
        started = 1;
        free(pixels);
    }
    if (started) exr_encoding_destroy(file, &encoder);
    return exr_finish(&file) == EXR_ERR_SUCCESS && ok;
}

/* OpenEXR writes, we read; `shift` compares with the wrong pixel. */
static void check_reading(int shift) {
    static const int sizes[][4] = {
        {1, 1, 0, 0}, {17, 33, -5, 11}, {200, 3, 1000, -7}, {64, 48, 0, 0}};
    static const exr_compression_t compressions[] = {EXR_COMPRESSION_NONE, EXR_COMPRESSION_RLE,
                                                     EXR_COMPRESSION_ZIPS, EXR_COMPRESSION_ZIP};
    int s, m, decreasing, kind, c, x, y;
    for (s = 0; s < 4; s++)
        for (m = 0; m < 4; m++)
            for (decreasing = 0; decreasing < 2; decreasing++)
                for (kind = 0; kind < 3; kind++) {
                    const int *size = sizes[s];
                    itn_image image = ITN_ZERO;
                    itn_error error = ITN_ZERO;
                    int wrong = 0;
                    if (!CHECK(openexr_write(size[0], size[1], size[2], size[3], compressions[m],
                                             decreasing, kind)))
                        continue;
                    check_report(!itn_image_load(path, NULL, &image, &error), __FILE__, __LINE__,
                                 "%s", error.message);
                    CHECK(image.width == size[0] && image.height == size[1] &&
                          image.plane_count == CHANNELS);
                    for (c = 0; c < image.plane_count; c++) {
                        CHECK(!strcmp(image.names[c], channel_names[c]));
                        for (y = 0; y < image.height; y++)
                            for (x = 0; x < image.width; x++)
                                wrong += !same_value(
                                    c, image.pixels[(c * image.height + y) * image.width + x],
                                    expected_value(c, stored_value(c, x + shift, y, kind)));
                    }
                    check_report(wrong == 0, __FILE__, __LINE__,
                                 "%d x %d, compression %d, order %d, kind %d: %d wrong", size[0],
                                 size[1], m, decreasing, kind, wrong);
                    itn_image_free(&image);
                }
}

/* What we refuse of what OpenEXR can write. */
static void test_refusals(void) {
    itn_image image;
    itn_error error = ITN_ZERO;
    CHECK(openexr_write(17, 33, 0, 0, EXR_COMPRESSION_PIZ, 0, 0));
    CHECK(itn_image_load(path, NULL, &image, &error) == ITN_ERROR_UNSUPPORTED);
    CHECK(strstr(error.message, "PIZ") != NULL);
}

/* Reads one block of a file with OpenEXR and compares it with the image. */
static int openexr_block(exr_const_context_t file, int y, const itn_image *image) {
    exr_decode_pipeline_t decoder = {0};
    exr_chunk_info_t chunk;
    float *row = (float *)calloc((size_t)image->width, sizeof *row * (size_t)image->plane_count);
    int k, ok = !exr_read_scanline_chunk_info(file, 0, y, &chunk) &&
                !exr_decoding_initialize(file, 0, &chunk, &decoder) &&
                decoder.channel_count == image->plane_count;
    for (k = 0; ok && k < decoder.channel_count; k++) {
        exr_coding_channel_info_t *channel = decoder.channels + k;
        ok = channel->data_type == EXR_PIXEL_FLOAT;
        if (k) ok = ok && strcmp(decoder.channels[k - 1].channel_name, channel->channel_name) < 0;
        channel->decode_to_ptr = (uint8_t *)(row + k * image->width);
        channel->user_bytes_per_element = 4;
        channel->user_data_type = EXR_PIXEL_FLOAT;
        channel->user_pixel_stride = 4;
        channel->user_line_stride = 4 * image->width;
    }
    ok = ok && !exr_decoding_choose_default_routines(file, 0, &decoder) &&
         !exr_decoding_run(file, 0, &decoder);
    for (k = 0; ok && k < image->plane_count; k++) {
        const float *plane = itn_image_plane(image, decoder.channels[k].channel_name);
        ok = plane && !memcmp(plane + y * image->width, row + k * image->width,
                              sizeof *row * (size_t)image->width);
    }
    exr_decoding_destroy(file, &decoder);
    free(row);
    return ok;
}

/* We write, OpenEXR reads; `damage` changes the image after it was written. */
static void check_writing(int damage) {
    static const int sizes[][3] = {{1, 1, 1}, {17, 33, 3}, {200, 3, 14}, {128, 128, 6}};
    int s, i, y, total;
    for (s = 0; s < 4; s++) {
        exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
        exr_context_t file = NULL;
        exr_attr_box2i_t window;
        exr_compression_t compression = EXR_COMPRESSION_ZIP;
        itn_image image = ITN_ZERO;
        int ok = 1;
        itn_image_create(sizes[s][0], sizes[s][1], sizes[s][2], NULL, &image, NULL);
        total = sizes[s][0] * sizes[s][1] * sizes[s][2];
        for (i = 0; i < image.plane_count; i++)
            snprintf(image.names[i], ITN_NAME_SIZE, "%s%d.Y",
                     i % 3 == 2 ? "d_an_item_with_a_name_of_many_letters_" : "yVd" + i % 3, 99 - i);
        for (i = 0; i < total; i++) {
            uint32_t bits = i % 50 == 3 ? 0x7fc12345u : i % 50 == 4 ? 0xff800000u : random_bits();
            memcpy(image.pixels + i, &bits, 4);
        }
        CHECK(itn_image_save_exr(&image, path, NULL) == ITN_OK);
        if (damage) memcpy(image.pixels, "\0\1\2\3", 4);
        if (CHECK(exr_start_read(&file, path, &init) == EXR_ERR_SUCCESS)) {
            CHECK(!exr_get_data_window(file, 0, &window) && window.min.x == 0 &&
                  window.min.y == 0 && window.max.x == image.width - 1 &&
                  window.max.y == image.height - 1);
            CHECK(!exr_get_compression(file, 0, &compression) &&
                  compression == EXR_COMPRESSION_NONE);
            for (y = 0; y < image.height; y++) ok = ok && openexr_block(file, y, &image);
            CHECK(ok);
        }
        exr_finish(&file);
        itn_image_free(&image);
    }
}

int main(void) {
    strcpy(directory, "/tmp/itn-openexr-XXXXXX");
    if (!mkdtemp(directory)) return printf("no temporary directory\n"), 1;
    snprintf(path, sizeof path, "%s/image.exr", directory);
    check_reading(0);
    CHECK_CATCHES(check_reading(1));
    test_refusals();
    check_writing(0);
    CHECK_CATCHES(check_writing(1));
    remove(path);
    CHECK(rmdir(directory) == 0);
    return check_end("openexr");
}
