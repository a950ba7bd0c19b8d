/* Files: numbers, inflate, EXR, PFM, PNG, OBJ and PLY. Round trips are exact to the bit; damaged
   bytes of every kind, failing memory and failing disks give errors and nothing else. */
#define _XOPEN_SOURCE 700 /* mkdtemp, symlink */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "accountant.h"
#include "check.h"
#include "fuzz.h"
#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static char directory[64];

static const char *in_directory(const char *name) {
    static char path[2][160];
    static int turn;
    turn = !turn;
    snprintf(path[turn], sizeof path[turn], "%s/%s", directory, name);
    return path[turn];
}

static uint64_t random_state = 1;
static uint32_t random_bits(void) {
    random_state += 0x9e3779b97f4a7c15ull;
    return (uint32_t)(itn__mix64(random_state) >> 32);
}

static void put_u8(itn__buffer *b, unsigned value) { itn__put_number(b, value & 255, 1, 0); }
static void put_u32(itn__buffer *b, uint32_t value) { itn__put_number(b, value, 4, 0); }
static void put_u64(itn__buffer *b, uint64_t value) { itn__put_number(b, value, 8, 0); }
static void put_float(itn__buffer *b, float value) { itn__put_floats(b, &value, 1); }
static itn_result write_file(const char *path, const void *bytes, size_t size, itn_error *error) {
    itn__buffer buffer = ITN_ZERO;
    itn__put(&buffer, bytes, size);
    return itn__write_file(path, &buffer, error);
}
static void put_text(itn__buffer *b, const char *text) { itn__put(b, text, strlen(text)); }
static uint64_t get_u64(const unsigned char *bytes) { return itn__from_bytes(bytes, 8, 0); }

/* ---- loading bytes with every promise checked ---- */

static int mesh_valid(const itn_mesh *mesh) {
    int i, ok = mesh->vertex_count > 0 && mesh->triangle_count > 0;
    for (i = 0; i < 3 * mesh->triangle_count; i++)
        ok &= mesh->triangles[i] >= 0 && mesh->triangles[i] < mesh->vertex_count;
    for (i = 0; i < 3 * mesh->vertex_count; i++) ok &= itn__finite(mesh->positions[i]);
    for (i = 0; mesh->uvs && i < 6 * mesh->triangle_count; i++) ok &= itn__finite(mesh->uvs[i]);
    return ok;
}

/* Loads bytes from a block of exactly their size; checks that failure fills the error, leaves the
   output alone and leaks nothing, and that success gives valid contents. Returns the result. */
static itn_result load_checked(int is_mesh, const unsigned char *bytes, size_t size, long fail_at,
                               accountant *a) {
    unsigned char *block = (unsigned char *)malloc(size ? size : 1);
    itn_context context;
    itn_error error;
    itn_mesh mesh, mesh_before;
    itn_image image, image_before;
    itn_result result;
    memset(a, 0, sizeof *a);
    memset(&error, 0, sizeof error);
    a->fail_at = fail_at;
    context = count_context(a);
    if (size) memcpy(block, bytes, size);
    memset(&mesh, 0x5a, sizeof mesh), memset(&mesh_before, 0x5a, sizeof mesh);
    memset(&image, 0x5a, sizeof image), memset(&image_before, 0x5a, sizeof image);
    result = is_mesh ? itn_mesh_from_memory(block, size, "bytes", &context, &mesh, &error)
                     : itn_image_from_memory(block, size, "bytes", &context, &image, &error);
    free(block);
    if (result) {
        CHECK(error.code == result && strlen(error.message) > 5 && a->live == 0);
        CHECK(!memcmp(&mesh, &mesh_before, sizeof mesh));
        CHECK(!memcmp(&image, &image_before, sizeof image));
    } else if (is_mesh) {
        CHECK(mesh_valid(&mesh));
        itn_mesh_free(&mesh);
    } else {
        CHECK(image.width > 0 && image.height > 0 && image.plane_count > 0);
        itn_image_free(&image);
    }
    CHECK(a->live == 0);
    return result;
}

/* All shorter lengths, `count` random changes of 1 to 4 bytes, memory failing at every call. */
static void abuse(int is_mesh, const unsigned char *bytes, size_t size, int count,
                  int short_fails) {
    unsigned char *damaged = (unsigned char *)malloc(size);
    accountant a;
    size_t length;
    long k;
    int i, changes;
    CHECK(load_checked(is_mesh, bytes, size, 0, &a) == ITN_OK);
    for (length = 0; length < size; length++) {
        itn_result result = load_checked(is_mesh, bytes, length, 0, &a);
        if (short_fails) CHECK(result != ITN_OK);
    }
    for (i = 0; i < count; i++) {
        memcpy(damaged, bytes, size);
        for (changes = 1 + (int)(random_bits() % 4); changes > 0; changes--) {
            size_t at = random_bits() % size;
            unsigned kind = random_bits() % 4;
            damaged[at] = (unsigned char)(kind == 0   ? random_bits()
                                          : kind == 1 ? 0xff
                                          : kind == 2 ? damaged[at] ^ 1u << random_bits() % 8
                                                      : bytes[random_bits() % size]);
        }
        load_checked(is_mesh, damaged, size, 0, &a);
        CHECK(a.largest < 1032.0 * 16 * (double)size + 300000);
    }
    for (k = 1; load_checked(is_mesh, bytes, size, k, &a) != ITN_OK; k++)
        CHECK(load_checked(is_mesh, bytes, size, k, &a) == ITN_ERROR_MEMORY);
    CHECK(k > 1);
    free(damaged);
}

/* ---- numbers ---- */

static double parse(const char *text) {
    double value = -12345;
    const char *end = text + strlen(text);
    return itn__parse_number(text, end, &value) == end ? value : NAN;
}

/* Distance in units in the last place. */
static double files_ulps(double a, double b) {
    double unit = nextafter(fabs(b), INFINITY) - fabs(b);
    return a == b ? 0 : fabs(a - b) / unit;
}

static void check_numbers(double nudge) {
    static const char *const bad[] = {"", "-", "+", ".", "e5", "1e", "1e+", "--1", "nan", "inf",
                                      "0x10", "1,5", "1.2.3", "- 1", "1e1.5", "infinity"};
    static const char *const good[] = {"0", "-0", "1.", ".5", "+3", "-.25e1", "1E5", "007",
                                       "1e-5", "1e22", "1e23", "123456789012345",
                                       "0.000000000000000000000000000001",
                                       "3.4028235e38", "1.17549435e-38", "4.9e-324",
                                       "1.7976931348623157e308", "1e400", "1e-400",
                                       "1e99999999999999999999", "0e999999999999",
                                       "123456789012345678901234567890",
                                       "0.00000000000000000000000000000000000000001e41"};
    size_t i;
    int n;
    for (i = 0; i < sizeof bad / sizeof *bad; i++) CHECK(parse(bad[i]) != parse(bad[i]));
    for (i = 0; i < sizeof good / sizeof *good; i++)
        CHECK(files_ulps(parse(good[i]) * nudge, strtod(good[i], NULL)) <= 10 ||
              (isinf(parse(good[i])) && isinf(strtod(good[i], NULL))));
    CHECK(signbit(parse("-0")));
    for (n = 0; n < 200000; n++) {
        char text[64];
        uint64_t wide = (uint64_t)random_bits() << 32 | random_bits();
        uint32_t bits = random_bits();
        float number, read;
        memcpy(&number, &bits, 4);
        if (itn__finite(number)) { /* floats printed with 9 digits come back as they were */
            snprintf(text, sizeof text, "%.9g", (double)number);
            read = (float)(parse(text) * nudge);
            if (memcmp(&read, &number, 4)) CHECK(!"float comes back");
        }
        snprintf(text, sizeof text, "%.0fe%d", (double)(wide % 1000000000000000ull),
                 (int)(random_bits() % 45) - 22);
        if (parse(text) * nudge != strtod(text, NULL)) CHECK(!"15 digits are exact");
        snprintf(text, sizeof text, "%.0f.%ue%d", (double)wide, bits,
                 (int)(random_bits() % 580) - 300);
        if (!(files_ulps(parse(text) * nudge, strtod(text, NULL)) <= 10)) CHECK(!"within 10 ulp");
    }
    CHECK(n == 200000);
}

/* Composes text both ways; ours gets `point` for its point. */
static int same_text(const char *format, double value, char point) {
    char ours[100], theirs[100], *mark;
    size_t length = itn__print(ours, sizeof ours, format, value);
    int expected = snprintf(theirs, sizeof theirs, format, value);
    mark = strchr(ours, '.');
    if (mark) *mark = point;
    return (int)length == expected && !strcmp(ours, theirs);
}

/* What is printed is what printf prints, whatever the number. */
static void check_printing(char point) {
    static const char *const formats[] = {"%g", "%.2g", "%.0f", "%.9g", "%.1g", "%.0g"};
    static const double values[] = {0, 1, -1, 9.5, 99.95, 999999.5, 1e15, 123456, 1234567, 1e-4,
                                    9.9999e-5, .5, 1.5, 2.5, .125, 1e22, 1e-300, 4.9e-324, 1e308,
                                    DBL_MAX, INFINITY, -INFINITY, FLT_MAX, 0.1, 1e5, 1e6, 100};
    char text[8];
    size_t f, i;
    int n, same = 1;
    for (f = 0; f < sizeof formats / sizeof *formats; f++) {
        int whole = f == 2; /* only of whole numbers */
        for (i = 0; i < sizeof values / sizeof *values; i++)
            if (!whole || (fabs(values[i]) < 1e12 && values[i] == rint(values[i])))
                check_report(same_text(formats[f], values[i], point), __FILE__, __LINE__,
                             "%s of %.17g", formats[f], values[i]);
        for (n = 0; n < 20000; n++) {
            double x = (double)random_bits() / 4294967296. - .5;
            int power = (int)(random_bits() % 600) - 300;
            same &= same_text(formats[f], whole ? rint(2e6 * x) + 0 : x * pow(10, power), point);
            same &= same_text(formats[f], (double)(random_bits() >> random_bits() % 32), point);
        }
    }
    CHECK(same);
    CHECK(itn__print(text, sizeof text, "%d,%s%%%c", INT_MIN, "abc", 'x') == 17);
    CHECK(!strcmp(text, "-214748"));
    itn__print(text, sizeof text, "%.2s|%.*s", "abc", 1, "xyz");
    CHECK(!strcmp(text, "ab|x"));
    itn__print(text, sizeof text, "%d %g", 0, NAN);
    CHECK(!strcmp(text, "0 nan"));
    CHECK(itn__print(NULL, 0, "%d", 100) == 3);
}

/* ---- a compressor, for what is to be read back ---- */

static unsigned reverse_bits(unsigned code, int length) {
    unsigned reversed = 0;
    for (; length > 0; length--, code >>= 1) reversed = reversed << 1 | (code & 1);
    return reversed;
}

/* Returns NULL, or what is wrong. */
static const char *zlib_decode(const unsigned char *data, size_t size, unsigned char *bytes,
                               size_t capacity) {
    static itn_error error;
    itn__text text = itn__text_make(data, size, "zlib");
    text.error = &error;
    itn__zlib_decode(&text, bytes, capacity);
    return text.result ? error.message : NULL;
}

static const uint16_t length_base[] = {3,  4,  5,  6,  7,  8,  9,  10,  11,  13,
                                            15, 17, 19, 23, 27, 31, 35, 43,  51,  59,
                                            67, 83, 99, 115, 131, 163, 195, 227, 258};
static const uint16_t distance_base[] = {
    1,   2,   3,   4,   5,   7,    9,    13,   17,   25,   33,   49,   65,    97,    129,
    193, 257, 385, 513, 769, 1025, 1537, 2049, 3073, 4097, 6145, 8193, 12289, 16385, 24577};
/* How many extra bits follow a length symbol (counted from 257) or a distance symbol. */
static int length_bits(int symbol) {
    return symbol < 8 || symbol == 28 ? 0 : (symbol - 4) / 4;
}
static int distance_bits(int symbol) { return symbol < 4 ? 0 : (symbol - 2) / 2; }

typedef struct bit_writer {
    itn__buffer *out;
    uint32_t bits;
    int count;
} bit_writer;

/* Appends the lowest `count` (at most 16) bits of a value, the lowest first. */
static void put_bits(bit_writer *writer, unsigned value, int count) {
    writer->bits |= (uint32_t)value << writer->count;
    for (writer->count += count; writer->count >= 8; writer->count -= 8) {
        put_u8(writer->out, writer->bits & 255);
        writer->bits >>= 8;
    }
}

/* Appends a literal or length symbol in the fixed code of RFC 1951, 3.2.6. */
static void put_symbol(bit_writer *writer, int symbol) {
    int length = symbol < 144 ? 8 : symbol < 256 ? 9 : symbol < 280 ? 7 : 8;
    int code = symbol < 144   ? 0x30 + symbol
               : symbol < 256 ? 0x190 + symbol - 144
               : symbol < 280 ? symbol - 256
                              : 0xc0 + symbol - 280;
    put_bits(writer, reverse_bits((unsigned)code, length), length);
}

/* Appends a copy of `length` (3 to 258) bytes from `distance` (1 to 32768) bytes back. */
static void put_copy(bit_writer *writer, int length, int distance) {
    int symbol = 28;
    while (length_base[symbol] > length) symbol--;
    put_symbol(writer, symbol + 257);
    put_bits(writer, (unsigned)(length - length_base[symbol]), length_bits(symbol));
    symbol = 29;
    while (distance_base[symbol] > distance) symbol--;
    put_bits(writer, reverse_bits((unsigned)symbol, 5), 5);
    put_bits(writer, (unsigned)(distance - distance_base[symbol]),
                  distance_bits(symbol));
}

/* How many of the bytes at `at` (at most 258) are those `distance` back. */
static int copy_length(const unsigned char *bytes, size_t at, size_t size, size_t distance) {
    int length = 0;
    if (distance > at || distance > 32768) return 0;
    while (length < 258 && at < size && bytes[at] == bytes[at - distance]) length++, at++;
    return length;
}

/* Compresses rows of `stride` bytes to a zlib stream, with fixed Huffman codes and copies of the
   pixel to the left or above. */
static void zlib_encode(const unsigned char *bytes, size_t size, size_t stride,
                             itn__buffer *out) {
    bit_writer writer = ITN_ZERO;
    uint32_t sum = itn__adler32(1, bytes, size);
    size_t at = 0;
    int i;
    writer.out = out;
    put_u8(out, 0x78);
    put_u8(out, 0x01);
    put_bits(&writer, 3, 3); /* the last block, with fixed codes */
    while (at < size && !out->failed) {
        int left = copy_length(bytes, at, size, 3);
        int above = copy_length(bytes, at, size, stride);
        if (left < 3 && above < 3) {
            put_symbol(&writer, bytes[at++]);
        } else {
            put_copy(&writer, left >= above ? left : above, left >= above ? 3 : (int)stride);
            at += (size_t)(left >= above ? left : above);
        }
    }
    put_symbol(&writer, 256);
    put_bits(&writer, 0, 7); /* fills the last byte */
    for (i = 24; i >= 0; i -= 8) put_u8(out, sum >> i);
}

/* ---- inflate ---- */

static void test_inflate(void) {
    static const unsigned char dynamic[] = {
        120, 218, 45,  144, 1,   142, 69,  33,  8,   3,   75,  193, 138, 134, 251, 159, 119,
        235, 251, 107, 8,   105, 71,  69,  16,  104, 4,   176, 128, 18,  188, 138, 120, 158,
        79,  95,  147, 198, 92,  172, 139, 143, 6,   42,  112, 159, 24,  139, 8,   42,  110,
        7,   210, 42,  66,  177, 226, 187, 57,  76,  112, 137, 34,  89,  108, 19,  242, 171,
        72,  4,   145, 111, 23,  43,  49,  217, 72,  40,  201, 28,  228, 116, 186, 16,  190,
        168, 78,  69,  34,  83,  76,  150, 59,  170, 65,  181, 5,   203, 13,  54,  75,  105,
        83,  248, 172, 123, 122, 189, 143, 39,  112, 209, 5,   173, 214, 98,  61,  139, 94,
        202, 39,  10,  255, 100, 224, 145, 116, 169, 119, 110, 84,  182, 250, 194, 240, 219,
        50,  175, 16,  157, 177, 129, 61,  181, 89,  251, 233, 216, 168, 141, 222, 184, 91,
        182, 220, 87,  27,  185, 75,  237, 63,  74,  248, 205, 166, 103, 168, 142, 234, 107,
        141, 30,  67,  127, 95,  119, 94,  231, 19,  56,  93,  47,  11,  135, 56,  192, 9,
        157, 245, 35,  247, 176, 79,  26,  234, 252, 1,   160, 110, 5,   139};
    static const unsigned char stored[] = {120, 1,  0,  5,  0,  250, 255, 'a', 'b', 'c', 'd',
                                           'e', 1,  3,  0,  252, 255, 'f', 'g', 'h', 0,   0,
                                           0,   0};
    unsigned char expected[400], out[400], copy[400], block[64];
    uint32_t x = 12345, sum;
    size_t size;
    int i, k, wrong = 0;
    for (i = 0; i < 400; i++) {
        x = (x * 1103515245u + 12345u) & 0x7fffffffu;
        expected[i] = (unsigned char)(i % 3 ? (x >> 16) % 7 * ((x >> 20) % 3) : (uint32_t)i / 40);
    }
    CHECK((dynamic[2] >> 1 & 3) == 2);
    CHECK(zlib_decode(dynamic, sizeof dynamic, out, 400) == NULL);
    CHECK(!memcmp(out, expected, 400));
    CHECK(zlib_decode(dynamic, sizeof dynamic, out, 399) != NULL);
    for (size = 0; size < sizeof dynamic; size++)
        wrong += zlib_decode(dynamic, size, out, 400) == NULL;
    for (i = 0; i < 8 * (int)sizeof dynamic; i++) { /* every single bit flipped */
        memcpy(copy, dynamic, sizeof dynamic);
        copy[i / 8] ^= (unsigned char)(1 << i % 8);
        if (i >= 16 || (i / 8 == 0 && i % 8 < 4))
            wrong += zlib_decode(copy, sizeof dynamic, out, 400) == NULL &&
                     memcmp(out, expected, 400);
    }
    CHECK(wrong == 0);
    memcpy(block, stored, sizeof stored);
    sum = itn__adler32(1, (const unsigned char *)"abcdefgh", 8);
    CHECK(sum == 0x0e000325u); /* RFC 1950: a = 1 + 97 + .. + 104, b the sum of all a */
    for (k = 0; k < 4; k++)
        block[sizeof stored - 4 + (size_t)k] = (unsigned char)(sum >> (24 - 8 * k));
    CHECK(zlib_decode(block, sizeof stored, out, 8) == NULL && !memcmp(out, "abcdefgh", 8));
    block[sizeof stored - 1] ^= 1;
    CHECK(strstr(zlib_decode(block, sizeof stored, out, 8), "checksum is wrong") != NULL);
    for (i = 0; i < 200000; i++) { /* noise behind a valid header never crashes */
        for (k = 2; k < 64; k++) block[k] = (unsigned char)random_bits();
        block[0] = 0x78, block[1] = 1, block[2] &= 0xfe;
        block[2] = (unsigned char)((block[2] & 0xf8) | 4 | (i & 1));
        zlib_decode(block, 64, out, 400);
    }
}

/* A block whose codes have the lengths 1, 2, .. 15, 15 (symbols 0 .. 14, 256), written by hand. The
   lengths themselves are sent with 13 codes of 4 bits and 6 of 5. */
static void test_long_codes(void) {
    static const unsigned char order[] = {16, 17, 18, 0, 8,  7, 9,  6, 10, 5,
                                          11, 4,  12, 3, 13, 2, 14, 1, 15};
    itn__buffer packed = ITN_ZERO;
    bit_writer writer = ITN_ZERO;
    unsigned char bytes[300], out[300];
    uint32_t sum;
    int i, length;
    writer.out = &packed;
    put_u8(&packed, 0x78);
    put_u8(&packed, 0x01);
    put_bits(&writer, 1 | 2 << 1, 3);
    put_bits(&writer, 0, 5);  /* 257 literal codes */
    put_bits(&writer, 0, 5);  /* 1 distance code */
    put_bits(&writer, 15, 4); /* 19 lengths of lengths */
    for (i = 0; i < 19; i++) put_bits(&writer, order[i] < 13 ? 4 : 5, 3);
    for (i = 0; i < 258; i++) {
        length = i < 15 ? i + 1 : i == 256 ? 15 : 0;
        if (length < 13)
            put_bits(&writer, reverse_bits((unsigned)length, 4), 4);
        else
            put_bits(&writer, reverse_bits((unsigned)(26 + length - 13), 5), 5);
    }
    for (i = 0; i < 300; i++) { /* code of symbol n: n ones and a zero */
        bytes[i] = (unsigned char)(i % 15);
        put_bits(&writer, (1u << bytes[i]) - 1, bytes[i] + 1);
    }
    put_bits(&writer, 0x7fff, 15);
    put_bits(&writer, 0, 7);
    sum = itn__adler32(1, bytes, 300);
    for (i = 24; i >= 0; i -= 8) put_u8(&packed, sum >> i);
    CHECK(zlib_decode(packed.bytes, packed.size, out, 300) == NULL);
    CHECK(!memcmp(bytes, out, 300));
    itn__buffer_free(&packed);
}

/* A block whose code lengths are sent as repeats of the last one (symbol 16, of all four sizes):
   255 literals and the end with 8 bits each. Lengths 8, 0 and 16 have the codes 0, 10 and 11. */
static void test_repeated_lengths(void) {
    itn__buffer packed = ITN_ZERO;
    bit_writer writer = ITN_ZERO;
    unsigned char bytes[255], out[255];
    uint32_t sum;
    int i, left;
    writer.out = &packed;
    put_u8(&packed, 0x78);
    put_u8(&packed, 0x01);
    put_bits(&writer, 1 | 2 << 1, 3);
    put_bits(&writer, 0, 5);
    put_bits(&writer, 0, 5);
    put_bits(&writer, 1, 4); /* 5 lengths of lengths: for 16, 17, 18, 0 and 8 */
    for (i = 0; i < 5; i++) put_bits(&writer, i == 0 || i == 3 ? 2 : i == 4 ? 1 : 0, 3);
    put_bits(&writer, 0, 1);
    for (left = 254, i = 0; left >= 6; i = (i + 1) % 4) {
        put_bits(&writer, 3, 2);
        put_bits(&writer, (unsigned)i, 2);
        left -= 3 + i;
    }
    for (; left; left--) put_bits(&writer, 0, 1);
    put_bits(&writer, 1, 2); /* 255 has no code */
    put_bits(&writer, 0, 1); /* 256 */
    put_bits(&writer, 1, 2); /* nor has the distance */
    for (i = 0; i < 255; i++) {
        bytes[i] = (unsigned char)i;
        put_bits(&writer, reverse_bits(bytes[i], 8), 8);
    }
    put_bits(&writer, 255, 8);
    put_bits(&writer, 0, 7);
    sum = itn__adler32(1, bytes, 255);
    for (i = 24; i >= 0; i -= 8) put_u8(&packed, sum >> i);
    CHECK(zlib_decode(packed.bytes, packed.size, out, 255) == NULL);
    CHECK(!memcmp(bytes, out, 255));
    itn__buffer_free(&packed);
}

/* Compression and back, for data of every flavour; `damage` flips a bit of the result. */
static void check_deflate(int damage) {
    int n, i;
    for (n = 0; n < 300; n++) {
        size_t size = random_bits() % 5000, stride = 1 + random_bits() % 700, k;
        unsigned char *bytes = (unsigned char *)malloc(size + 1);
        unsigned char *back = (unsigned char *)malloc(size + 1);
        unsigned range = n % 3 == 0 ? 1 : n % 3 == 1 ? 3 : 256;
        itn__buffer packed = ITN_ZERO;
        for (k = 0; k < size; k++) bytes[k] = (unsigned char)(255 - random_bits() % range);
        for (i = 0; i < 5 && size > stride; i++)
            memmove(bytes + stride, bytes, size - stride - random_bits() % (size - stride));
        zlib_encode(bytes, size, stride, &packed);
        if (CHECK(zlib_decode(packed.bytes, packed.size, back, size) == NULL) && size) {
            back[size / 2] ^= (unsigned char)damage;
            CHECK(!memcmp(bytes, back, size));
        }
        itn__buffer_free(&packed);
        free(bytes);
        free(back);
    }
}

/* ---- images ---- */

/* Planes of arbitrary bits, also NaNs and infinities; plain: only ordinary numbers. */
static itn_image random_image(int width, int height, int planes, const itn_context *context) {
    itn_image image = ITN_ZERO;
    int i, total = width * height * planes;
    if (itn_image_create(width, height, planes, context, &image, NULL)) return image;
    for (i = 0; i < planes; i++)
        snprintf(image.names[i], ITN_NAME_SIZE, "%c%d.Y", "zaQ_"[i % 4], planes - i);
    for (i = 0; i < total; i++) {
        uint32_t bits = random_bits();
        if (i == 0) bits = 0x7fc12345u;
        if (i == 1) bits = 0xff800000u;
        memcpy(image.pixels + i, &bits, 4);
    }
    return image;
}

/* Whether b has all planes of a under the same names, bit for bit. */
static int same_planes(const itn_image *a, const itn_image *b) {
    size_t bytes = (size_t)a->width * (size_t)a->height * sizeof(float);
    int i, same = a->width == b->width && a->height == b->height &&
                  a->plane_count == b->plane_count;
    for (i = 0; same && i < a->plane_count; i++) {
        const float *other = itn_image_plane(b, a->names[i]);
        same = other && !memcmp(other, itn_image_plane(a, a->names[i]), bytes);
    }
    return same;
}

static void check_exr_round_trip(int damage) {
    static const int sizes[][3] = {{1, 1, 1}, {17, 33, 3}, {200, 3, 7}, {3, 64, 1}, {5, 4, 40}};
    size_t i;
    for (i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        itn_image image = random_image(sizes[i][0], sizes[i][1], sizes[i][2], NULL);
        itn_image back = ITN_ZERO;
        itn_error error = ITN_ZERO;
        const char *path = in_directory("image.exr");
        if (i == 2) strcpy(image.names[3], "d_a_name_of_an_item_with_very_many_letters_sigma_t.Y");
        CHECK(itn_image_save_exr(&image, path, &error) == ITN_OK);
        if (CHECK(itn_image_load(path, NULL, &back, &error) == ITN_OK)) {
            if (damage) memcpy(back.pixels, "\1\2\3\4", 4);
            CHECK(same_planes(&image, &back));
        }
        itn_image_free(&back);
        itn_image_free(&image);
    }
}

static void check_pfm_round_trip(int damage) {
    int planes;
    for (planes = 1; planes <= 3; planes += 2) {
        itn_image image = random_image(19, 7, 4, NULL), back = ITN_ZERO;
        const char *path = in_directory("image.pfm");
        size_t plane = 19 * 7;
        CHECK(itn_image_save_pfm(&image, 1, planes, path, NULL) == ITN_OK);
        if (CHECK(itn_image_load(path, NULL, &back, NULL) == ITN_OK)) {
            CHECK(back.plane_count == planes && !strcmp(back.names[0], planes == 1 ? "Y" : "R"));
            if (damage) back.pixels[plane / 2] = 12345;
            CHECK(!memcmp(back.pixels, image.pixels + plane, plane * (size_t)planes * 4));
        }
        itn_image_free(&back);
        itn_image_free(&image);
    }
}

static void test_pfm_variants(void) {
    static const struct {
        const char *text;
        size_t pixel_bytes;
        itn_result result;
    } cases[] = {{"Pf\n2 1\n-1\n", 8, ITN_OK},          {"Pf 2\t1 1.0\n", 8, ITN_OK},
                 {"PF\r\n2 1\r\n-1.0\n", 24, ITN_OK},
                 {"PF\r\n2 1\r\n-1.0\r\n", 24, ITN_OK}, {"Pf\n2 1\n-1\r", 8, ITN_OK},
                 {"Pf\n2 1\n-1\r\n", 9, ITN_ERROR_FORMAT}, {"Pf\n2 1\n0\n", 8, ITN_ERROR_FORMAT},
                 {"Pf\n2 1\n-1\n", 7, ITN_ERROR_FORMAT},  {"Pf\n2 1\n-1\n", 9, ITN_ERROR_FORMAT},
                 {"Pf\n-2 1\n-1\n", 8, ITN_ERROR_FORMAT}, {"Pf\n2.5 1\n-1\n", 8, ITN_ERROR_FORMAT},
                 {"Pf\n9e8 9e8\n-1\n", 8, ITN_ERROR_FORMAT},
                 {"Pf\n1e30 1\n-1\n", 8, ITN_ERROR_FORMAT},
                 {"Pf\nnan 1\n-1\n", 8, ITN_ERROR_FORMAT}, {"P6\n2 1\n255\n", 6, ITN_ERROR_FORMAT}};
    unsigned char bytes[64];
    size_t i, length;
    accountant a;
    for (i = 0; i < sizeof cases / sizeof *cases; i++) {
        length = strlen(cases[i].text);
        memcpy(bytes, cases[i].text, length);
        memset(bytes + length, 0, sizeof bytes - length);
        CHECK(load_checked(0, bytes, length + cases[i].pixel_bytes, 0, &a) == cases[i].result);
        CHECK(a.largest < 4096);
    }
    { /* a file that was written as text on Windows; a line feed may be part of the first number */
        static const char *const text[] = {"Pf\r\n1 1\r\n-1\r\n\0\0\x80\x3f",
                                           "Pf 1 1 -1\r\n\0\x80\x3f"};
        static const size_t size[] = {17, 14};
        static const float value[] = {1, 1.00000119f};
        itn_image image;
        for (i = 0; i < 2; i++) {
            CHECK(itn_image_from_memory(text[i], size[i], NULL, NULL, &image, NULL) == ITN_OK);
            CHECK(image.pixels[0] == value[i]);
            itn_image_free(&image);
        }
    }
    { /* the size of the scale is what numbers are multiplied by, in both byte orders */
        static const char *const text[] = {"Pf\n1 1\n-255\n\0\0\x80\x3f",
                                           "Pf\n1 1\n.0025\n\x44\x7a\0\0",
                                           "Pf\n1 1\n-1\n\x01\0\xc0\x7f"};
        static const size_t size[] = {16, 17, 14};
        static const float value[] = {255, 2.5f};
        itn_image image;
        uint32_t nan;
        for (i = 0; i < 3; i++) {
            CHECK(itn_image_from_memory(text[i], size[i], NULL, NULL, &image, NULL) == ITN_OK);
            memcpy(&nan, image.pixels, 4);
            CHECK(i < 2 ? image.pixels[0] == value[i] : nan == 0x7fc00001);
            itn_image_free(&image);
        }
    }
    { /* the same number in both byte orders, the lower row first */
        itn_image image;
        memcpy(bytes, "Pf\n1 2\n1\n\x40\x49\x0f\xdb\x3f\x80\0\0", 17);
        CHECK(itn_image_from_memory(bytes, 17, NULL, NULL, &image, NULL) == ITN_OK);
        CHECK(image.pixels[1] == 3.14159274f && image.pixels[0] == 1);
        itn_image_free(&image);
    }
}

/* ---- EXR files of the test's own making ---- */

static void put_attribute(itn__buffer *b, const char *name, const void *value, size_t size) {
    itn__put(b, name, strlen(name) + 1);
    itn__put(b, "x", 2);
    put_u32(b, (uint32_t)size);
    itn__put(b, value, size);
}

/* Moves even and odd places apart, takes differences: the reverse of what the reader does. */
static void predict(const unsigned char *raw, unsigned char *coded, size_t size) {
    size_t i;
    for (i = 0; i < size; i++) coded[i / 2 + (i & 1 ? (size + 1) / 2 : 0)] = raw[i];
    for (i = size - 1; size && i > 0; i--)
        coded[i] = (unsigned char)(coded[i] - coded[i - 1] + 128);
}

static void pack_runs(const unsigned char *bytes, size_t size, itn__buffer *out) {
    size_t i, run;
    for (i = 0; i < size; i += run) {
        for (run = 1; run < 128 && i + run < size && bytes[i + run] == bytes[i];) run++;
        put_u8(out, run > 2 ? (unsigned)run - 1 : (unsigned)(256 - run));
        itn__put(out, bytes + i, run > 2 ? 1 : run);
    }
}

/* A file of channels F (float), H (half), U (uint) whose pixel x, y holds x + 3 y, a data window at
   (-5, 7) and blocks in any order. shown: the display window, NULL: there is none. */
static itn__buffer make_exr_in(int width, int height, int compression, int decreasing,
                               const int32_t *shown) {
    itn__buffer file = ITN_ZERO, raw = ITN_ZERO, list = ITN_ZERO;
    int lines = compression == 3 ? 16 : 1, blocks = (height + lines - 1) / lines, i, x, y, c;
    size_t table;
    unsigned char compression_byte = (unsigned char)compression;
    int32_t window[4];
    window[0] = -5, window[1] = 7, window[2] = -5 + width - 1, window[3] = 7 + height - 1;
    for (c = 0; c < 3; c++) {
        char name[2] = {0, 0};
        name[0] = "FHU"[c];
        itn__put(&list, name, 2);
        put_u32(&list, c == 0 ? 2 : c == 1 ? 1 : 0);
        itn__put(&list, "\0\0\0\0\1\0\0\0\1\0\0", 12);
    }
    put_u8(&list, 0);
    itn__put(&file, "\x76\x2f\x31\x01\2\0\0", 8);
    put_attribute(&file, "channels", list.bytes, list.size);
    put_attribute(&file, "owner", "nobody at all", 13);
    put_attribute(&file, "compression", &compression_byte, 1);
    put_attribute(&file, "dataWindow", window, 16); /* tests run on little-endian machines */
    if (shown) put_attribute(&file, "displayWindow", shown, 16);
    put_u8(&file, 0);
    table = file.size;
    for (i = 0; i < blocks; i++) put_u64(&file, 0);
    for (i = 0; i < blocks; i++) {
        int block = decreasing ? blocks - 1 - i : i;
        itn__buffer packed = ITN_ZERO;
        uint64_t offset = file.size;
        unsigned char *coded;
        raw.size = 0;
        for (y = block * lines; y < height && y < (block + 1) * lines; y++)
            for (c = 0; c < 3; c++)
                for (x = 0; x < width; x++) {
                    unsigned value = (unsigned)(x + 3 * y), e = 0, half;
                    while (value >> (e + 1)) e++;
                    half = value ? (e + 15) << 10 | ((value << 10 >> e) & 1023) : 0;
                    if (c == 0) put_float(&raw, (float)value);
                    if (c == 1) put_u8(&raw, half & 255);
                    if (c == 1) put_u8(&raw, half >> 8);
                    if (c == 2) put_u32(&raw, value);
                }
        coded = (unsigned char *)malloc(raw.size);
        predict(raw.bytes, coded, raw.size);
        if (compression == 1) pack_runs(coded, raw.size, &packed);
        if (compression >= 2) zlib_encode(coded, raw.size, 7, &packed);
        free(coded);
        if (compression == 0 || packed.size >= raw.size) {
            packed.size = 0;
            itn__put(&packed, raw.bytes, raw.size);
        }
        memcpy(file.bytes + table + 8 * (size_t)block, &offset, 8);
        put_u32(&file, (uint32_t)(7 + block * lines));
        put_u32(&file, (uint32_t)packed.size);
        itn__put(&file, packed.bytes, packed.size);
        itn__buffer_free(&packed);
    }
    itn__buffer_free(&raw);
    itn__buffer_free(&list);
    return file;
}

static itn__buffer make_exr(int width, int height, int compression, int decreasing) {
    return make_exr_in(width, height, compression, decreasing, NULL);
}

static void test_exr_variants(void) {
    static const int sizes[][2] = {{1, 1}, {17, 33}, {200, 3}, {64, 16}};
    int compression, decreasing, i, c, x, y;
    for (i = 0; i < 4; i++)
        for (compression = 0; compression < 4; compression++)
            for (decreasing = 0; decreasing < 2; decreasing++) {
                itn__buffer file = make_exr(sizes[i][0], sizes[i][1], compression, decreasing);
                itn_image image = ITN_ZERO;
                int wrong = 0;
                CHECK(itn_image_from_memory(file.bytes, file.size, NULL, NULL, &image, NULL) ==
                      ITN_OK);
                CHECK(image.width == sizes[i][0] && image.height == sizes[i][1] &&
                      image.plane_count == 3 && !strcmp(image.names[1], "H"));
                for (c = 0; c < image.plane_count; c++)
                    for (y = 0; y < image.height; y++)
                        for (x = 0; x < image.width; x++)
                            wrong += image.pixels[(c * image.height + y) * image.width + x] !=
                                     (float)(x + 3 * y);
                CHECK(wrong == 0);
                itn_image_free(&image);
                if (i == 0 || (i == 3 && !decreasing))
                    abuse(0, file.bytes, file.size, i == 0 ? 3000 : 300, 1);
                itn__buffer_free(&file);
            }
}

static void test_half(void) {
    uint32_t h;
    int wrong = 0;
    for (h = 0; h < 65536; h++) { /* against the definition, in double */
        uint32_t e = h >> 10 & 31, m = h & 1023;
        double value = e ? ldexp(1024.0 + m, (int)e - 25) : ldexp((double)m, -24);
        float got = itn__half_to_float(h);
        if (e == 31)
            wrong += m ? got == got : !isinf(got);
        else
            wrong += (double)fabsf(got) != value;
        wrong += !!signbit(got) != (h >> 15 == 1);
    }
    CHECK(wrong == 0);
}

/* Sets a number in the bytes behind a text, loads, and expects a refusal without much memory. */
static void lie(const char *after, size_t skip, uint32_t value, size_t width, itn_result expected) {
    itn__buffer file = make_exr(17, 33, 3, 0);
    size_t i, length = strlen(after);
    accountant a;
    for (i = 0; i + length < file.size && memcmp(file.bytes + i, after, length); i++) continue;
    memcpy(file.bytes + i + length + skip, &value, width);
    check_report(load_checked(0, file.bytes, file.size, 0, &a) == expected, __FILE__, __LINE__,
                 "lie about %s: %u", after, value);
    CHECK(a.largest < 1e6);
    itn__buffer_free(&file);
}

/* 1024 channels are read, one more is not; of names 63 characters. */
static void test_exr_limits(void) {
    int channels, length, i, k, rest;
    for (channels = 1023; channels <= 1025; channels++)
        for (length = 63; length <= 64; length++) {
            itn__buffer file = ITN_ZERO, list = ITN_ZERO;
            accountant a;
            for (i = 0; i < channels; i++) {
                char name[65] = "";
                for (k = length, rest = i; k--; rest /= 10) name[k] = (char)('0' + rest % 10);
                itn__put(&list, name, (size_t)length + 1);
                itn__put(&list, "\2\0\0\0\0\0\0\0\1\0\0\0\1\0\0", 16);
            }
            put_u8(&list, 0);
            itn__put(&file, "\x76\x2f\x31\x01\2\4\0", 8);
            put_attribute(&file, "channels", list.bytes, list.size);
            put_attribute(&file, "compression", "", 1);
            put_attribute(&file, "dataWindow", "\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", 16);
            put_u8(&file, 0);
            put_u64(&file, file.size + 8);
            put_u32(&file, 0);
            put_u32(&file, (uint32_t)channels * 4);
            for (i = 0; i < channels; i++) put_float(&file, 1);
            CHECK(load_checked(0, file.bytes, file.size, 0, &a) ==
                  (channels > 1024 ? ITN_ERROR_UNSUPPORTED : ITN_OK));
            itn_image image = ITN_ZERO;
            if (!itn_image_from_memory(file.bytes, file.size, NULL, NULL, &image, NULL))
                CHECK(strlen(image.names[channels - 1]) == 63 &&
                      !memcmp(image.names[channels - 1], "0000", 4));
            itn_image_free(&image);
            itn__buffer_free(&list);
            itn__buffer_free(&file);
        }
}

static void test_exr_lies(void) {
    lie("\x76\x2f\x31\x01", 1, 0x02, 1, ITN_ERROR_UNSUPPORTED);  /* tiled */
    lie("\x76\x2f\x31\x01", 1, 0x08, 1, ITN_ERROR_UNSUPPORTED);  /* deep */
    lie("\x76\x2f\x31\x01", 1, 0x10, 1, ITN_ERROR_UNSUPPORTED);  /* parts */
    lie("\x76\x2f\x31\x01", 0, 0x03, 1, ITN_ERROR_UNSUPPORTED);  /* version */
    lie("compression", 7, 4, 1, ITN_ERROR_UNSUPPORTED);          /* PIZ */
    lie("compression", 7, 77, 1, ITN_ERROR_UNSUPPORTED);         /* of some version to come */
    lie("compression", 3, 0xffffffffu, 4, ITN_ERROR_FORMAT);     /* attribute size */
    lie("dataWindow", 7, 0x7fffffffu, 4, ITN_ERROR_FORMAT);      /* x0 behind x1 */
    lie("dataWindow", 15, 0x7fffffffu, 4, ITN_ERROR_FORMAT);     /* 2^31 columns */
    lie("dataWindow", 19, 0x7fffffffu, 4, ITN_ERROR_FORMAT);     /* 2^31 rows */
    lie("dataWindow", 19, 1000000, 4, ITN_ERROR_FORMAT);
    lie("dataWindow", 3, 12, 4, ITN_ERROR_FORMAT);
    lie("channels", 9, 3, 1, ITN_ERROR_FORMAT);                  /* type of F */
    lie("channels", 17, 2, 1, ITN_ERROR_UNSUPPORTED);            /* its sampling */
    lie("channels", 7, 'H', 1, ITN_ERROR_FORMAT);                /* two of one name */
    lie("dataWindo", 0, 'W', 1, ITN_ERROR_FORMAT);               /* no data window */
}

/* Two blocks of an uncompressed file of 4096 x 2 pixels, the second of which begins within the
   first: more bytes are asked for than the file has. planted: it begins where it should. */
static void test_exr_shared_bytes(int planted) {
    enum { WIDTH = 4096 };
    itn_image image;
    itn__buffer file = ITN_ZERO;
    size_t table, first;
    accountant a;
    CHECK(itn_image_create(WIDTH, 2, 1, NULL, &image, NULL) == ITN_OK);
    strcpy(image.names[0], "Y");
    CHECK(itn_image_save_exr(&image, in_directory("image.exr"), NULL) == ITN_OK);
    CHECK(itn__read_file(in_directory("image.exr"), SIZE_MAX / 4, NULL, &file, NULL) == ITN_OK);
    first = file.size - 2 * (8 + 4 * WIDTH), table = first - 16;
    CHECK(get_u64(file.bytes + table) == first);
    if (!planted) {
        uint64_t second = first + 8;
        memcpy(file.bytes + second, file.bytes + first + 8 + 4 * WIDTH, 8);
        memcpy(file.bytes + table + 8, &second, 8);
        file.size = first + 16 + 4 * WIDTH;
    }
    CHECK(load_checked(0, file.bytes, file.size, 0, &a) == ITN_ERROR_FORMAT);
    itn__buffer_free(&file);
    itn_image_free(&image);
}

/* Of a damaged block the error tells the place. */
static void test_exr_damaged_block(void) {
    enum { WIDTH = 64, BLOCK = 8 + 4 * WIDTH };
    itn_image image;
    itn__buffer file = ITN_ZERO;
    itn_error error = ITN_ZERO;
    char place[40];
    CHECK(itn_image_create(WIDTH, 4, 1, NULL, &image, NULL) == ITN_OK);
    strcpy(image.names[0], "Y");
    CHECK(itn_image_save_exr(&image, in_directory("image.exr"), NULL) == ITN_OK);
    itn_image_free(&image);
    CHECK(itn__read_file(in_directory("image.exr"), SIZE_MAX / 4, NULL, &file, NULL) == ITN_OK);
    file.bytes[file.size - 2 * BLOCK]--; /* the row of the last block but one: there is one */
    CHECK(itn_image_from_memory(file.bytes, file.size, NULL, NULL, &image, &error));
    sprintf(place, "byte %d: EXR block 2: ", (int)file.size - 2 * BLOCK);
    check_report(strstr(error.message, place) != NULL, __FILE__, __LINE__, "%s", error.message);
    itn__buffer_free(&file);
}

/* A table that was never filled in, of a program that was stopped, or that is wrong: the blocks are
   there all the same. planted: another pixel is expected. */
static void check_exr_empty_table(int wrong, int planted) {
    itn__buffer file = make_exr(17, 33, 3, 1);
    itn_image image = ITN_ZERO;
    uint64_t entry, first = file.size;
    size_t i;
    for (i = 0; i + 8 < file.size; i++) { /* the table: three offsets, the first one the largest */
        entry = get_u64(file.bytes + i);
        if (entry < file.size && entry > i + 16 && get_u64(file.bytes + i + 8) < entry &&
            get_u64(file.bytes + i + 16) == i + 24) {
            memset(file.bytes + i, wrong, 16);
            first = i;
            break;
        }
    }
    CHECK(first < file.size);
    CHECK(itn_image_from_memory(file.bytes, file.size, NULL, NULL, &image, NULL) == ITN_OK);
    CHECK(image.pixels && image.pixels[17 * 33 - 1 - planted] == 16 + 3 * 32);
    itn_image_free(&image);
    itn__buffer_free(&file);
}

/* The display window is the image: 0 where there are no data, and data beyond it are left out.
   planted: one pixel further. */
static void check_exr_windows(int planted) {
    static const int32_t windows[][4] = {{-9, 3, 20, 50}, {-2, 10, 3, 20}, {0, 0, 100, 8},
                                         {-5, 7, 11, 39}, {100, 100, 101, 101}};
    static const int32_t bad[][4] = {{0, 0, 5, -1}, {0, 0, 0x7fffffff, 0x7fffffff},
                                     {-0x7fffffff, 0, 0x7fffffff, 0}, {0, 0, 999, 999}};
    size_t i;
    int compression, x, y, c;
    accountant a;
    for (i = 0; i < sizeof windows / sizeof *windows; i++)
        for (compression = 0; compression < 4; compression += 3) {
            const int32_t *w = windows[i];
            itn__buffer file = make_exr_in(17, 33, compression, 0, w);
            itn_image image = ITN_ZERO;
            int wrong = 0;
            CHECK(!itn_image_from_memory(file.bytes, file.size, NULL, NULL, &image, NULL));
            CHECK(image.width == w[2] - w[0] + 1 && image.height == w[3] - w[1] + 1);
            for (c = 0; c < image.plane_count; c++)
                for (y = 0; y < image.height; y++)
                    for (x = 0; x < image.width; x++) {
                        int column = x + w[0] + 5 + planted, row = y + w[1] - 7;
                        int inside = column >= 0 && column < 17 && row >= 0 && row < 33;
                        wrong += *itn__pixel(&image, c, y, x) !=
                                 (inside ? (float)(column + 3 * row) : 0);
                    }
            CHECK(wrong == 0);
            itn_image_free(&image);
            itn__buffer_free(&file);
        }
    for (i = 0; i < sizeof bad / sizeof *bad; i++) {
        itn__buffer file = make_exr_in(17, i == 3 ? 3 : 33, 3, 0, bad[i]);
        CHECK(load_checked(0, file.bytes, file.size, 0, &a) == ITN_ERROR_FORMAT);
        CHECK(a.largest < 1e6);
        itn__buffer_free(&file);
    }
}

static void test_image_arguments(void) {
    itn_image image = random_image(4, 3, 3, NULL);
    itn_error error = ITN_ZERO;
    const char *path = in_directory("never");
    CHECK(itn_image_save_exr(NULL, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_save_exr(&image, NULL, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_save_pfm(&image, 0, 2, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_save_pfm(&image, 1, 3, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_save_pfm(&image, -1, 1, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_save_pfm(&image, INT_MAX, 1, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_save_png(&image, 0, 3, ITN_PNG_TONE, NAN, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_save_png(&image, 0, 3, ITN_PNG_TONE, -1, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_save_png(&image, 0, 1, (itn_png_mode)7, 0, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_from_memory("", 0, NULL, NULL, &image, &error) == ITN_ERROR_FORMAT);
    CHECK(itn_image_from_memory(NULL, 0, NULL, NULL, &image, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_load(NULL, NULL, &image, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_image_load(path, NULL, &image, &error) == ITN_ERROR_FILE);
    CHECK(strstr(error.message, "never") != NULL);
    CHECK(itn_image_load(directory, NULL, &image, &error) == ITN_ERROR_FILE);
    image.width = image.height = 60000; /* refused before a pixel is looked at */
    CHECK(itn_image_save_png(&image, 0, 3, ITN_PNG_TONE, 1, path, &error) == ITN_ERROR_ARGUMENT);
    image.width = 4, image.height = 3;
    image.context.allocate = count_allocate; /* half an allocator */
    CHECK(itn_image_save_exr(&image, path, &error) == ITN_ERROR_ARGUMENT);
    image.context.allocate = NULL;
    strcpy(image.names[1], image.names[0]);
    CHECK(itn_image_save_exr(&image, path, &error) == ITN_ERROR_ARGUMENT);
    image.names[1][0] = 0;
    CHECK(itn_image_save_exr(&image, path, &error) == ITN_ERROR_ARGUMENT);
    memset(image.names[1], 'x', ITN_NAME_SIZE);
    CHECK(itn_image_save_exr(&image, path, &error) == ITN_ERROR_ARGUMENT);
    CHECK(access(path, F_OK) != 0);
    itn_image_free(&image);
}

/* ---- PNG ---- */

static uint32_t big_endian(const unsigned char *bytes) {
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

/* Reads a PNG file of three chunks back to its pixels ([height][1 + 3 width] with filter bytes). */
static unsigned char *read_png(const char *path, int *width, int *height) {
    itn__buffer file = ITN_ZERO;
    unsigned char *rows = NULL, *at;
    size_t size;
    *width = *height = 0;
    if (itn__read_file(path, 1 << 24, NULL, &file, NULL)) return NULL;
    at = file.bytes + 8;
    CHECK(!memcmp(file.bytes, "\x89PNG\r\n\x1a\n", 8));
    CHECK(big_endian(at) == 13 && !memcmp(at + 4, "IHDR", 4) && !memcmp(at + 16, "\10\2\0\0\0", 5));
    *width = (int)big_endian(at + 8), *height = (int)big_endian(at + 12);
    at += 25;
    size = big_endian(at);
    CHECK(!memcmp(at + 4, "IDAT", 4) && (size_t)(at - file.bytes) + size + 24 == file.size);
    CHECK(!memcmp(at + 12 + size, "\0\0\0\0IEND\xae\x42\x60\x82", 12)); /* known CRC */
    rows = (unsigned char *)malloc((size_t)*height * (1 + 3 * (size_t)*width));
    CHECK(zlib_decode(at + 8, size, rows, (size_t)*height * (1 + 3 * (size_t)*width)) == NULL);
    itn__buffer_free(&file);
    return rows;
}

static void check_png(float wrong_scale) {
    itn_image image = ITN_ZERO;
    const char *path = in_directory("image.png");
    unsigned char *rows;
    int width, height, i;
    itn_image_create(200, 1, 3, NULL, &image, NULL);
    for (i = 0; i < 600; i++) image.pixels[i] = (float)(i % 200) / 100 - 0.5f;
    image.pixels[7] = NAN;
    image.pixels[8] = INFINITY;
    image.pixels[9] = -INFINITY;
    CHECK(itn_image_save_png(&image, 0, 1, ITN_PNG_TONE, 2 * wrong_scale, path, NULL) == ITN_OK);
    rows = read_png(path, &width, &height);
    CHECK(width == 200 && height == 1 && rows[0] == 0);
    CHECK(rows[1 + 21] == 255 && rows[1 + 22] == 0 && rows[1 + 23] == 255);
    CHECK(rows[1 + 24] == 255 && rows[1 + 27] == 0);
    for (i = 10; i < 200; i++) { /* against the curve in double */
        double x = fmin(1, fmax(0, 2 * (double)image.pixels[i]));
        double y = x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055;
        CHECK_NEAR(rows[1 + 3 * i], 255 * y, 0.501);
        CHECK(rows[1 + 3 * i] == rows[2 + 3 * i] && rows[1 + 3 * i] == rows[3 + 3 * i]);
    }
    free(rows);
    /* signed, automatic: the 99th percentile of 200 sizes is the 198th, 1.47 */
    for (i = 0; i < 200; i++) image.pixels[i] = (float)(i % 2 ? -i : i);
    CHECK(itn_image_save_png(&image, 0, 1, ITN_PNG_SIGNED, 0, path, NULL) == ITN_OK);
    rows = read_png(path, &width, &height);
    for (i = 0; i < 200; i++) {
        double y = fmin(1, i / 197.0) * 255 * (double)wrong_scale;
        CHECK_NEAR(rows[1 + 3 * i], i % 2 ? 0 : y, 0.501);
        CHECK_NEAR(rows[3 + 3 * i], i % 2 ? y : 0, 0.501);
        CHECK(rows[2 + 3 * i] == 0);
    }
    free(rows);
    /* signed, three planes: their mean */
    for (i = 0; i < 600; i++) image.pixels[i] = (float)(i / 200 + i % 200 - 100);
    CHECK(itn_image_save_png(&image, 0, 3, ITN_PNG_SIGNED, .01f, path, NULL) == ITN_OK);
    rows = read_png(path, &width, &height);
    for (i = 0; i < 200; i++) CHECK_NEAR(rows[1 + 3 * i] - rows[3 + 3 * i],
                                         fmin(255, (i - 99) * 2.55), 0.501);
    free(rows);
    itn_image_free(&image);
}

static int byte_of(float light) { return (int)(itn__encode((double)light, 0) * 255 + .5); }

static void test_png_shapes(void) {
    int n;
    for (n = 0; n < 60; n++) {
        int width = 1 + (int)(random_bits() % 90), height = 1 + (int)(random_bits() % 40), w, h, i;
        itn_image image = ITN_ZERO;
        unsigned char *rows;
        int x, y, k, wrong = 0;
        itn_image_create(width, height, 3, NULL, &image, NULL);
        for (i = 0; i < 3 * width * height; i++)
            image.pixels[i] =
                n % 3 == 0 ? 0 : (float)(random_bits() % (n % 3 == 1 ? 2 : 256)) / 255;
        CHECK(itn_image_save_png(&image, 0, 3, ITN_PNG_TONE, 1, in_directory("n.png"), NULL) ==
              ITN_OK);
        rows = read_png(in_directory("n.png"), &w, &h);
        CHECK(w == width && h == height);
        for (y = 0; y < h; y++)
            for (x = 0; x < w; x++)
                for (k = 0; k < 3; k++)
                    wrong += rows[y * (1 + 3 * w) + 1 + 3 * x + k] !=
                             byte_of(image.pixels[(k * h + y) * w + x]);
        CHECK(wrong == 0);
        free(rows);
        if (n == 0) /* black, automatic scale */
            CHECK(!itn_image_save_png(&image, 0, 1, ITN_PNG_SIGNED, 0, in_directory("n.png"),
                                      NULL));
        itn_image_free(&image);
    }
}

/* Rows of more bytes than a stored block has come back; planted: another width. */
static void check_png_wide(int planted) {
    static const int widths[] = {20999, 21000, 21001, 45678};
    int n, x, wrong;
    for (n = 0; n < 4; n++) {
        itn_image image = ITN_ZERO, back = ITN_ZERO;
        CHECK(!itn_image_create(widths[n], 2, 1, NULL, &image, NULL));
        for (x = 0; x < 2 * widths[n]; x++) image.pixels[x] = (float)(x % 251) / 255;
        CHECK(!itn_image_save_png(&image, 0, 1, ITN_PNG_TONE, 1, in_directory("n.png"), NULL));
        CHECK(!itn_image_load(in_directory("n.png"), NULL, &back, NULL));
        CHECK(back.width == widths[n] + planted && back.height == 2 && back.plane_count == 3);
        for (x = wrong = 0; back.pixels && x < 2 * widths[n]; x++)
            wrong += byte_of(back.pixels[x]) != byte_of(image.pixels[x]);
        CHECK(wrong == 0);
        itn_image_free(&image), itn_image_free(&back);
    }
}

/* ---- PNG files of the test's own making ---- */

static void put_big(itn__buffer *b, uint32_t value) { itn__put_number(b, value, 4, 1); }

static void put_chunk(itn__buffer *png, const char *type, const void *data, size_t size) {
    put_big(png, (uint32_t)size);
    itn__put(png, type, 4);
    itn__put(png, data, size);
    put_big(png, itn__crc32(png->bytes + png->size - size - 4, size + 4));
}

/* Codes of all samples [height][width][samples]; other: chunks behind the header. */
typedef struct png_case {
    int width, height, depth, type, samples;
    const unsigned *codes;
    itn__buffer other;
} png_case;

/* Filters a row by the definition; `above` may be NULL. */
static void filter_row(const unsigned char *raw, const unsigned char *above, size_t size,
                       size_t step, int filter, unsigned char *out) {
    size_t i;
    for (i = 0; i < size; i++) {
        int a = i >= step ? raw[i - step] : 0, b = above ? above[i] : 0;
        int c = i >= step && above ? above[i - step] : 0, p = a + b - c, q = c;
        if (abs(p - a) <= abs(p - b) && abs(p - a) <= abs(p - c)) q = a;
        else if (abs(p - b) <= abs(p - c)) q = b;
        q = filter == 4 ? q : filter == 3 ? (a + b) / 2 : filter == 2 ? b : filter ? a : 0;
        out[i] = (unsigned char)(raw[i] - q);
    }
}

static itn__buffer make_png(const png_case *c) {
    itn__buffer png = ITN_ZERO, header = ITN_ZERO, rows = ITN_ZERO, packed = ITN_ZERO;
    size_t bits = (size_t)(c->depth * c->samples), line = ((size_t)c->width * bits + 7) / 8, at, n;
    unsigned char *raw = (unsigned char *)calloc(2, line), *filtered = (unsigned char *)malloc(line);
    int y, i;
    itn__put(&png, "\x89PNG\r\n\x1a\n", 8);
    put_big(&header, (uint32_t)c->width), put_big(&header, (uint32_t)c->height);
    put_u8(&header, (unsigned)c->depth), put_u8(&header, (unsigned)c->type);
    itn__put(&header, "\0\0\0", 3);
    put_chunk(&png, "IHDR", header.bytes, header.size);
    put_chunk(&png, "tEXt", "Comment\0of no use", 17);
    if (c->other.size) itn__put(&png, c->other.bytes, c->other.size);
    for (y = 0; y < c->height; y++) {
        int filter = (int)(random_bits() % 5), count = c->width * c->samples;
        unsigned char *row = raw + (y & 1 ? line : 0), *above = raw + (y & 1 ? 0 : line);
        memset(row, 0, line);
        for (i = 0; i < count; i++) {
            unsigned code = c->codes[y * count + i];
            size_t bit = (size_t)(i * c->depth);
            if (c->depth == 16) row[bit / 8] = (unsigned char)(code >> 8), row[bit / 8 + 1] = code & 255;
            else row[bit / 8] |= (unsigned char)(code << (8 - (size_t)c->depth - bit % 8));
        }
        filter_row(row, y ? above : NULL, line, (bits + 7) / 8, filter, filtered);
        put_u8(&rows, (unsigned)filter);
        itn__put(&rows, filtered, line);
    }
    zlib_encode(rows.bytes, rows.size, line + 1, &packed);
    for (at = 0; at < packed.size; at += n) { /* the stream in pieces */
        n = random_bits() % 3000;
        if (n > packed.size - at) n = packed.size - at;
        put_chunk(&png, "IDAT", packed.bytes + at, n);
    }
    put_chunk(&png, "IEND", "", 0);
    free(raw), free(filtered);
    itn__buffer_free(&header), itn__buffer_free(&rows), itn__buffer_free(&packed);
    return png;
}

static const struct { int type, samples, depth; } png_types[] = {
    {0, 1, 1}, {0, 1, 2}, {0, 1, 4}, {0, 1, 8}, {0, 1, 16}, {2, 3, 8}, {2, 3, 16}, {3, 1, 1},
    {3, 1, 2}, {3, 1, 4}, {3, 1, 8}, {4, 2, 8}, {4, 2, 16}, {6, 4, 8}, {6, 4, 16}};
enum { PNG_TYPES = sizeof png_types / sizeof *png_types };

/* A file of random pixels; codes: [height][width][samples], to be freed. */
static itn__buffer random_png(int index, int width, int height, int transparent, unsigned **codes,
                              unsigned char palette[4][256]) {
    png_case c = ITN_ZERO;
    itn__buffer png;
    int i, count, depth = png_types[index].depth, entries = 1 << (depth < 8 ? depth : 8);
    unsigned char bytes[768];
    c.width = width, c.height = height, c.depth = depth;
    c.type = png_types[index].type, c.samples = png_types[index].samples;
    count = width * height * c.samples;
    *codes = (unsigned *)malloc(sizeof **codes * (size_t)count);
    for (i = 0; i < count; i++) (*codes)[i] = random_bits() & ((1u << depth) - 1);
    for (i = 0; i < 1024; i++) palette[i / 256][i % 256] = (unsigned char)random_bits();
    if (!transparent) memset(palette[3], 255, 256);
    for (i = 0; i < 768; i++) bytes[i] = palette[i % 3][i / 3];
    if (c.type == 3) put_chunk(&c.other, "PLTE", bytes, 3 * (size_t)entries);
    if (c.type == 3 && transparent) put_chunk(&c.other, "tRNS", palette[3], (size_t)entries);
    c.codes = *codes;
    png = make_png(&c);
    itn__buffer_free(&c.other);
    return png;
}

/* Every type and depth against the definition; planted: a code is another. */
static void check_png_types(unsigned planted) {
    int index, size, transparent, x, y, k;
    for (index = 0; index < PNG_TYPES; index++)
        for (size = 0; size < 3; size++)
            for (transparent = 0; transparent < 2; transparent++) {
                static const int sizes[][2] = {{1, 1}, {37, 11}, {8, 90}};
                int width = sizes[size][0], height = sizes[size][1], type = png_types[index].type;
                int colours = type & 2 ? 3 : 1, samples = png_types[index].samples;
                int alpha = type > 3 || (type == 3 && transparent), wrong = 0;
                unsigned *codes, largest = type == 3 ? 255 : (1u << png_types[index].depth) - 1;
                unsigned char palette[4][256];
                itn__buffer file = random_png(index, width, height, transparent, &codes, palette);
                itn_image image = ITN_ZERO;
                itn_error error = ITN_ZERO;
                check_report(!itn_image_from_memory(file.bytes, file.size, "a.png", NULL, &image,
                                                    &error), __FILE__, __LINE__, "%s", error.message);
                codes[0] ^= planted;
                CHECK(image.width == width && image.height == height &&
                      image.codes == (int)largest && image.gamma == 0);
                CHECK(image.plane_count == colours + alpha && (itn_image_plane(&image, "A") != NULL) == alpha &&
                      itn_image_plane(&image, colours == 3 ? "B" : "Y"));
                for (y = 0; y < image.height; y++)
                    for (x = 0; x < image.width; x++)
                        for (k = 0; k < image.plane_count; k++) {
                            const unsigned *code = codes + (y * width + x) * samples;
                            double v = (type == 3 ? palette[k][code[0]] : code[k]) / (double)largest;
                            if (k < colours)
                                v = v <= .04045 ? v / 12.92 : pow((v + .055) / 1.055, 2.4);
                            wrong += !(fabs((double)*itn__pixel(&image, k, y, x) - v) <= 1e-7);
                        }
                CHECK(wrong == 0);
                itn_image_free(&image);
                itn__buffer_free(&file);
                free(codes);
            }
}

/* Makes the checksums of all whole chunks right. */
static void mend_png(unsigned char *bytes, size_t size) {
    size_t at = 8, length;
    for (; at + 12 <= size; at += length + 12) {
        uint32_t sum;
        int k;
        length = big_endian(bytes + at);
        if (length > size - at - 12) return;
        sum = itn__crc32(bytes + at + 4, length + 4);
        for (k = 0; k < 4; k++) bytes[at + 8 + length + (size_t)k] = (unsigned char)(sum >> (24 - 8 * k));
    }
}

/* Damage of every kind, with the checksums as they were and made right; then some of a kind. */
static void test_png_damage(void) {
    static const struct { const char *type; size_t at; unsigned value; itn_result result; } lies[] = {
        {"IHDR", 0, 0x80, ITN_ERROR_FORMAT},     {"IHDR", 1, 0xff, ITN_ERROR_FORMAT},
        {"IHDR", 3, 0, ITN_ERROR_FORMAT},        {"IHDR", 7, 99, ITN_ERROR_FORMAT},
        {"IHDR", 8, 3, ITN_ERROR_FORMAT},        {"IHDR", 8, 32, ITN_ERROR_FORMAT},
        {"IHDR", 8, 16, ITN_ERROR_FORMAT},       {"IHDR", 9, 1, ITN_ERROR_FORMAT},
        {"IHDR", 9, 7, ITN_ERROR_FORMAT},        {"IHDR", 9, 2, ITN_ERROR_FORMAT},
        {"IHDR", 10, 1, ITN_ERROR_FORMAT},       {"IHDR", 11, 1, ITN_ERROR_FORMAT},
        {"IHDR", 12, 1, ITN_ERROR_UNSUPPORTED},  {"IHDR", 12, 2, ITN_ERROR_FORMAT},
        {"IHDR", -4, 'i', ITN_ERROR_FORMAT},     {"IDAT", -4, 'J', ITN_ERROR_UNSUPPORTED},
        {"IDAT", 0, 0x79, ITN_ERROR_FORMAT},     {"IEND", -4, 'i', ITN_ERROR_FORMAT},
        {"tEXt", -4, 'T', ITN_ERROR_UNSUPPORTED}};
    unsigned *codes;
    unsigned char palette[4][256], *damaged;
    itn__buffer file = ITN_ZERO;
    accountant a;
    size_t k, i;
    int index, n;
    for (index = 0; index < PNG_TYPES; index++) {
        file = random_png(index, 9, 5, 1, &codes, palette);
        free(codes);
        abuse(0, file.bytes, file.size, 200, 1);
        damaged = (unsigned char *)malloc(file.size);
        for (n = 0; n < 1500; n++) {
            memcpy(damaged, file.bytes, file.size);
            for (k = 1 + random_bits() % 3; k; k--)
                damaged[8 + random_bits() % (file.size - 8)] ^= (unsigned char)(1 << random_bits() % 8);
            mend_png(damaged, file.size);
            load_checked(0, damaged, file.size, 0, &a);
            CHECK(a.largest < 1032. * 8 * 16 * (double)file.size + 300000);
        }
        free(damaged);
        itn__buffer_free(&file);
    }
    for (k = 0; k < sizeof lies / sizeof *lies; k++) {
        file = random_png(3, 9, 5, 0, &codes, palette);
        free(codes);
        for (i = 8; memcmp(file.bytes + i, lies[k].type, 4);) i++;
        file.bytes[i + 4 + lies[k].at] = (unsigned char)lies[k].value;
        mend_png(file.bytes, file.size);
        check_report(load_checked(0, file.bytes, file.size, 0, &a) == lies[k].result, __FILE__,
                     __LINE__, "PNG lie %d", (int)k);
        CHECK(a.largest < 300000); /* light of 16-bit codes */
        itn__buffer_free(&file);
    }
    { /* the error of a damaged chunk tells the place; each bit of a file counts, but of no text */
        itn_image image;
        itn_error error;
        file = random_png(3, 9, 5, 0, &codes, palette);
        free(codes);
        file.bytes[8 + 25 + 10]++;
        CHECK(itn_image_from_memory(file.bytes, file.size, "a.png", NULL, &image, &error));
        check_report(!strcmp(error.message, "a.png: byte 41: PNG chunk 1: checksum is wrong"),
                     __FILE__, __LINE__, "%s", error.message);
        itn__buffer_free(&file);
    }
}

/* One row of grey codes, and what the chunks behind the header say of their curve. */
static itn__buffer grey_png(int depth, int width, const unsigned *codes, const char *type,
                            const char *data, size_t size) {
    png_case c = ITN_ZERO;
    itn__buffer png;
    c.width = width, c.height = 1, c.depth = depth, c.samples = 1, c.codes = codes;
    if (type) put_chunk(&c.other, type, data, size);
    png = make_png(&c);
    itn__buffer_free(&c.other);
    return png;
}

/* gAMA states the curve, but where it stands for sRGB; sRGB wins; odd ones are refused. */
static void check_png_curves(double planted) {
    static const unsigned codes[] = {0, 1, 10, 128, 254, 255};
    static const struct { const char *type, *data; double gamma; } cases[] = {
        {"gAMA", "\0\1\x86\xa0", 1}, {"gAMA", "\0\0\xc3\x50", 2}, {"gAMA", "\0\0\xb1\x8f", 0},
        {"sRGB", "\0\0\0\0", 0}, {"gAMA", "\0\0\0\0", -1}, {"gAMA", "\xff\xff\xff\xff", -1},
        {"tRNS", "\0\0\0\0", -1}};
    size_t i;
    int k;
    for (i = 0; i < sizeof cases / sizeof *cases; i++) {
        itn__buffer file = grey_png(8, 6, codes, cases[i].type, cases[i].data, 4);
        itn_image image = ITN_ZERO;
        itn_result result = itn_image_from_memory(file.bytes, file.size, "a", NULL, &image, NULL);
        CHECK((result != ITN_OK) == (cases[i].gamma < 0));
        for (k = 0; k < 6 && !result; k++) {
            double code = codes[k] / 255., gamma = cases[i].gamma + planted;
            CHECK_NEAR(image.pixels[k], gamma > 0 ? pow(code, gamma)
                                        : code <= .04045 ? code / 12.92
                                                         : pow((code + .055) / 1.055, 2.4), 1e-6);
        }
        CHECK(result || image.gamma == (float)cases[i].gamma);
        itn_image_free(&image);
        itn__buffer_free(&file);
    }
}

/* Files of other formats are called by their names. */
static void test_other_formats(void) {
    static const struct { const char *bytes; size_t size; const char *word; } cases[] = {
        {"\xff\xd8\xff\xe0\0\x10JFIF", 10, "is a JPEG"}, {"#?RADIANCE\n", 11, "Radiance"},
        {"#?RGBE\n", 7, "Radiance"}, {"\0\0\0\x1c" "ftypheic", 12, "HEIC"},
        {"RIFF\1\2\3\4WEBPVP8", 15, "WebP"}, {"\x1f\x8b\x08\0", 4, "gzip"},
        {"solid cube\nfacet", 16, "STL"}, {"II*\0", 4, "TIFF"}, {"no picture", 10, "is not "},
        {"", 0, "is not "}};
    unsigned char stl[84 + 50] = "a binary one";
    itn_image image;
    itn_mesh mesh;
    itn_error error;
    size_t i;
    stl[80] = 1;
    for (i = 0; i < sizeof cases / sizeof *cases; i++) {
        CHECK(itn_image_from_memory(cases[i].bytes, cases[i].size, "x", NULL, &image, &error) ==
              ITN_ERROR_FORMAT);
        check_report(strstr(error.message, cases[i].word) && strstr(error.message, "PNG"), __FILE__,
                     __LINE__, "%s", error.message);
        CHECK(itn_mesh_from_memory(cases[i].bytes, cases[i].size, "x", NULL, &mesh, &error) ==
              ITN_ERROR_FORMAT);
        check_report(strstr(error.message, cases[i].word) && strstr(error.message, "PLY"), __FILE__,
                     __LINE__, "%s", error.message);
    }
    CHECK(itn_mesh_from_memory(stl, sizeof stl, "x", NULL, &mesh, &error) == ITN_ERROR_FORMAT);
    CHECK(strstr(error.message, "STL") != NULL);
}

/* ---- photos ---- */

static itn_film_desc film_of(int width, int height, int channels) {
    itn_film_desc film = ITN_ZERO;
    film.width = width, film.height = height, film.channels = channels;
    return film;
}

/* An image of planes "R", "G", "B" or "Y", and what other name is given. */
static itn_image planes_of(int width, int height, int channels, const char *other) {
    itn_image image = ITN_ZERO;
    int k;
    CHECK(!itn_image_create(width, height, channels + (other != NULL), NULL, &image, NULL));
    for (k = 0; k < channels; k++) image.names[k][0] = channels == 3 ? "RGB"[k] : 'Y';
    if (other) strcpy(image.names[channels], other);
    return image;
}

/* Means over areas: of a crop of a plane a x + b y + c, of any size, they are its values in the
   middle; the luminance of a grey film; planted: another crop. */
static void check_photo_means(int planted) {
    static const int sizes[][2] = {{12, 8}, {24, 16}, {30, 20}, {19, 13}, {13, 9}};
    int s, k, x, y, channels;
    for (s = 0; s < 5; s++)
        for (channels = 1; channels <= 3; channels += 2) {
            int width = sizes[s][0], height = sizes[s][1];
            itn_image image = planes_of(width + 9, height + 5, 3, "Variance.Y"), photo = ITN_ZERO;
            itn_photo_desc desc = ITN_ZERO;
            itn_error error = ITN_ZERO;
            double across = width / 12., down = height / 8.;
            for (k = 0; k < 3; k++)
                for (y = 0; y < height + 5; y++)
                    for (x = 0; x < width + 9; x++)
                        *itn__pixel(&image, k, y, x) = (float)(k + .25 * x + .5 * y);
            desc.crop_x = 4 + planted, desc.crop_y = 3;
            desc.crop_width = width, desc.crop_height = height;
            check_report(!itn_photo_make(&image, &desc, film_of(12, 8, channels), &photo, NULL,
                                         &error), __FILE__, __LINE__, "%s", error.message);
            CHECK(photo.plane_count == channels && !strcmp(photo.names[0], channels == 3 ? "R" : "Y"));
            for (k = 0; k < photo.plane_count; k++)
                for (y = 0; y < 8; y++)
                    for (x = 0; x < 12; x++) {
                        double value = .25 * (4 + (x + .5) * across - .5) +
                                       .5 * (3 + (y + .5) * down - .5);
                        value += channels == 3 ? k : .7152 + 2 * .0722;
                        /* a pixel is constant: its middle does not count as much as its share */
                        CHECK_NEAR(*itn__pixel(&photo, k, y, x), value,
                                   s < 2 ? 1e-5 : .25 * (.25 + .5) + 1e-5);
                    }
            itn_image_free(&photo);
            itn_image_free(&image);
        }
    { /* the total of shares is the total */
        itn_image image = random_image(61, 43, 1, NULL), photo = ITN_ZERO;
        double sum = 0, total = 0;
        for (k = 0; k < 61 * 43; k++)
            total += (double)(image.pixels[k] = (float)(random_bits() % 1000)) / (61 * 43);
        CHECK(!itn_photo_make(&image, NULL, film_of(17, 12, 1), &photo, NULL, NULL));
        for (k = 0; k < 17 * 12; k++) sum += (double)photo.pixels[k] / (17 * 12);
        CHECK_NEAR(sum, total, 1e-4 * total);
        itn_image_free(&photo);
        itn_image_free(&image);
    }
}

/* Variances: of rounding, through the curve; stated noise; layers; by how much means have less. */
static void check_photo_noise(double factor) {
    static unsigned codes[8] = {200, 200, 200, 200, 20, 20, 20, 20};
    static const char linear[] = "\0\1\x86\xa0";
    itn_photo_desc desc = ITN_ZERO;
    itn_image image = ITN_ZERO, photo = ITN_ZERO;
    itn__buffer file = grey_png(8, 8, codes, "gAMA", linear, 4);
    double value = 20 / 255., step = 1 / 255.;
    int k;
    CHECK(!itn_image_from_memory(file.bytes, file.size, NULL, NULL, &image, NULL));
    for (k = 0; k < 4; k++) {
        desc.gamma = k & 1 ? 2 : 0, desc.read_noise = k > 1 ? .01f : 0, desc.gain = k > 1 ? .001f : 0;
        CHECK(!itn_photo_make(&image, &desc, film_of(8, 1, 1), &photo, NULL, NULL));
        CHECK(photo.plane_count == 2 && !strcmp(photo.names[1], "Variance.Y"));
        {
            double v = k & 1 ? value * value : value, s = (k & 1 ? 2 * value : 1) * step;
            double variance = s * s / 12 + (k > 1 ? 1e-4 + .001 * v : s * s / 4);
            CHECK_NEAR(photo.pixels[4], v, 1e-7);
            CHECK_NEAR(photo.pixels[12], variance * factor, 1e-4 * variance);
        }
        itn_image_free(&photo);
    }
    itn_image_free(&image);
    itn__buffer_free(&file);
    /* four pixels each: 1/4 of what is independent, all of what is shared */
    image = planes_of(4, 4, 1, "Variance.Y");
    for (k = 0; k < 16; k++) image.pixels[k] = .5f, image.pixels[16 + k] = .04f;
    CHECK(!itn_photo_make(&image, NULL, film_of(2, 2, 1), &photo, NULL, NULL));
    CHECK_NEAR(photo.pixels[4], .01 * factor, 1e-8);
    itn_image_free(&photo);
    strcpy(image.names[1], "other"), image.codes = 255, image.gamma = 1;
    CHECK(!itn_photo_make(&image, NULL, film_of(2, 2, 1), &photo, NULL, NULL));
    CHECK_NEAR(photo.pixels[4], step * step * (1 / 48. + 1 / 4.) * factor, 1e-9);
    itn_image_free(&photo);
    image.codes = 65535; /* says next to nothing of its noise */
    CHECK(!itn_photo_make(&image, NULL, film_of(2, 2, 1), &photo, NULL, NULL));
    CHECK(photo.plane_count == 1);
    itn_image_free(&photo);
    itn_image_free(&image);
    /* a grey film's noise is that of channels that have it together */
    image = planes_of(1, 1, 3, NULL);
    desc.gamma = 0, desc.read_noise = .1f, desc.gain = 0;
    CHECK(!itn_photo_make(&image, &desc, film_of(1, 1, 1), &photo, NULL, NULL));
    CHECK_NEAR(photo.pixels[1], .01 * factor, 1e-6);
    itn_image_free(&photo);
    itn_image_free(&image);
}

/* What is transparent, masked or saturated masks all film pixels it is a part of, whatever it holds. */
static void test_photo_masks(void) {
    itn_image image = planes_of(6, 6, 1, "A"), mask = planes_of(6, 6, 1, NULL), photo = ITN_ZERO;
    itn_photo_desc desc = ITN_ZERO;
    itn_photo_report report;
    int k;
    for (k = 0; k < 36; k++) image.pixels[k] = .5f, image.pixels[36 + k] = mask.pixels[k] = 1;
    image.pixels[0] = NAN, image.pixels[36] = .99f; /* pixel 0, 0 is transparent */
    CHECK(!itn_photo_make(&image, NULL, film_of(3, 3, 1), &photo, &report, NULL));
    CHECK(photo.plane_count == 2 && report.masked == 1 && report.saturated == 0);
    for (k = 0; k < 9; k++)
        CHECK(photo.pixels[k] == (k ? .5f : 0) && photo.pixels[9 + k] == (k ? 0 : INFINITY));
    CHECK(report.clipped == 32 && report.largest == .5f);
    itn_image_free(&photo);
    mask.pixels[35] = .49f, image.pixels[3] = 2, desc.saturation = 1.5f, desc.mask = &mask;
    CHECK(!itn_photo_make(&image, &desc, film_of(3, 3, 1), &photo, &report, NULL));
    CHECK(report.masked == 3 && report.saturated == 1);
    CHECK(photo.pixels[9 + 1] == INFINITY && photo.pixels[9 + 8] == INFINITY);
    itn_image_free(&photo);
    /* 4 film pixels of 1.5 pixels each: one in the middle of two is a part of both */
    mask.pixels[35] = 1, mask.pixels[1] = 0, desc.saturation = 0;
    CHECK(!itn_photo_make(&image, &desc, film_of(4, 4, 1), &photo, &report, NULL));
    CHECK(report.masked == 2 && photo.pixels[17] == INFINITY && photo.pixels[18] == 0);
    itn_image_free(&photo);
    /* the largest code of a PNG is saturated */
    image.codes = 255, image.pixels[3] = 1, mask.pixels[1] = 1;
    CHECK(!itn_photo_make(&image, &desc, film_of(6, 6, 1), &photo, &report, NULL));
    CHECK(report.masked == 2 && report.saturated == 1 && photo.pixels[36 + 3] == INFINITY);
    itn_image_free(&photo);
    itn_image_free(&image);
    itn_image_free(&mask);
}

static void test_photo_refusals(void) {
    static const struct { int w, h, channels; itn_photo_desc desc; const char *word; } cases[] = {
        {3, 4, 1, {0, 0, 0, 0, 0, 0, 0, 0, NULL}, "shape"},
        {6, 3, 1, {0, 0, 0, 0, 0, 0, 0, 0, NULL}, "shape"},
        {7, 7, 1, {0, 0, 0, 0, 0, 0, 0, 0, NULL}, "less pixels"},
        {3, 3, 3, {0, 0, 0, 0, 0, 0, 0, 0, NULL}, "R, G and B"},
        {3, 3, 1, {1, 0, 6, 6, 0, 0, 0, 0, NULL}, "crop"},
        {3, 3, 1, {-1, 0, 6, 6, 0, 0, 0, 0, NULL}, "crop"},
        {3, 3, 1, {INT_MIN, INT_MIN, 0, 0, 0, 0, 0, 0, NULL}, "crop"},
        {3, 3, 1, {0, 0, 3, INT_MAX, 0, 0, 0, 0, NULL}, "crop"},
        {3, 3, 1, {6, 0, 0, 0, 0, 0, 0, 0, NULL}, "crop"},
        {3, 3, 1, {0, 0, 0, 0, NAN, 0, 0, 0, NULL}, "gamma"},
        {3, 3, 1, {0, 0, 0, 0, 0, 0, -1, 0, NULL}, "read noise"},
        {3, 3, 1, {0, 0, 0, 0, 0, 0, 0, NAN, NULL}, "gain"},
        {3, 3, 2, {0, 0, 0, 0, 0, 0, 0, 0, NULL}, "film"}};
    itn_image image = planes_of(6, 6, 1, NULL), photo, mask = planes_of(5, 6, 1, NULL);
    itn_photo_desc desc = ITN_ZERO;
    itn_error error = ITN_ZERO;
    size_t i;
    for (i = 0; i < sizeof cases / sizeof *cases; i++) {
        memset(&photo, 0x5a, sizeof photo);
        CHECK(itn_photo_make(&image, &cases[i].desc, film_of(cases[i].w, cases[i].h, cases[i].channels),
                             &photo, NULL, &error) == ITN_ERROR_ARGUMENT);
        check_report(strstr(error.message, cases[i].word) != NULL, __FILE__, __LINE__, "%s",
                     error.message);
        CHECK(photo.width == 0x5a5a5a5a);
    }
    desc.mask = &mask;
    CHECK(itn_photo_make(&image, &desc, film_of(3, 3, 1), &photo, NULL, &error));
    CHECK(strstr(error.message, "mask") != NULL);
    image.pixels[8] = NAN;
    CHECK(itn_photo_make(&image, NULL, film_of(3, 3, 1), &photo, NULL, &error));
    CHECK(strstr(error.message, "pixel 2, 1") != NULL);
    strcpy(image.names[0], "Z"); /* the only plane may have any name */
    image.pixels[8] = 1;
    CHECK(!itn_photo_make(&image, NULL, film_of(3, 3, 1), &photo, NULL, &error));
    itn_image_free(&photo);
    CHECK(itn_photo_make(NULL, NULL, film_of(3, 3, 1), &photo, NULL, NULL) == ITN_ERROR_ARGUMENT);
    CHECK(itn_photo_make(&image, NULL, film_of(3, 3, 1), NULL, NULL, NULL) == ITN_ERROR_ARGUMENT);
    itn_image_free(&image);
    itn_image_free(&mask);
}

/* ---- OBJ ---- */

static itn_mesh mesh_of(const char *text, itn_error *error) {
    itn_mesh mesh = ITN_ZERO;
    memset(error, 0, sizeof *error);
    itn_mesh_from_memory(text, strlen(text), "t.obj", NULL, &mesh, error);
    return mesh;
}

#define PLY_HEADER(format, elements) "ply\nformat " format " 1.0\n" elements "end_header\n"
#define PLY_VERTEX "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
#define PLY_FACE "element face 1\nproperty list uchar int vertex_indices\n"
#define SQUARE "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"

/* A text must give this many vertices and triangles, and uvs or not. */
static void expect_mesh(const char *text, int vertices, int triangles, int uvs) {
    itn_error error;
    itn_mesh mesh = mesh_of(text, &error);
    check_report(mesh.vertex_count == vertices && mesh.triangle_count == triangles &&
                     (mesh.uvs != NULL) == uvs, __FILE__, __LINE__,
                 "%s gives %d vertices, %d triangles (%s)", text, mesh.vertex_count,
                 mesh.triangle_count, error.message);
    itn_mesh_free(&mesh);
}

/* A text must be refused at this line, for a reason that contains `why`. */
static void expect_refusal(const char *text, int line, const char *why) {
    itn_error error;
    itn_mesh mesh = mesh_of(text, &error);
    check_report(error.code && mesh.positions == NULL && error.line == line &&
                     strstr(error.message, why) != NULL, __FILE__, __LINE__,
                 "%s: line %d, '%s'", text, error.line, error.message);
    itn_mesh_free(&mesh);
}

static void test_obj(void) {
    itn_error error;
    itn_mesh mesh;
    expect_mesh(SQUARE "f 1 2 3\n", 4, 1, 0);
    expect_mesh(SQUARE "f 1 2 3 4", 4, 2, 0);
    expect_mesh(SQUARE "f -4 -3 -2 -1\n", 4, 2, 0);
    expect_mesh("\xef\xbb\xbf# mark\r\nv 0 0 0\r\nv 1 0 0 1.0\r\n\tv 1 1 0 .5 .5 .5  \r\n\r\n"
                "o a\r\ng b\r\ns 1\r\nusemtl c\r\nf 1 2 3 # one\r\n", 3, 1, 0);
    expect_mesh("v 0 0 0\rv 1 0 0\rv 1 1 0\rf 1 2 3\r", 3, 1, 0);
    expect_mesh("v 0 \\\n 0 0\nv 1 0\\\r\n 0\nv 1 1 0\nf 1 2\\\n 3\n", 3, 1, 0);
    expect_mesh("# ends in a backslash \\\nv 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", 3, 1, 0);
    expect_mesh(SQUARE "vn 0 0 1\nf 1//1 2//1 3//-1\n", 4, 1, 0);
    expect_mesh(SQUARE "vn nan -nan(ind) nan\nf 1//1 2//1 3//-1\n", 4, 1, 0); /* not used */
    expect_mesh("v 0 0 0 nan 1 1\nv 1 0 0\nv 1 1 0\nvt 0 0 nan\nf 1/1 2/1 3/1\n", 3, 1, 1);
    expect_mesh(SQUARE "vt 0 0\nvt 1 0 0\nvt 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/3/1\nf 1/1 2/2 3/-1\n",
                4, 2, 1);
    expect_mesh(SQUARE "vt 0 0\nf 1/1 2/1 3/1\nf 1 2 3\n", 4, 2, 0);
    expect_mesh(SQUARE "f 1/ 2/ 3/\n", 4, 1, 0);
    mesh = mesh_of("v 1.5 -2e-1 +3\nv 1 0 0\nv 1 1 0\nvt .25 .5\nvt 1 0\nf 2/2 1/1 3/2", &error);
    CHECK(mesh.positions[0] == 1.5f && mesh.positions[1] == -0.2f && mesh.positions[2] == 3);
    CHECK(mesh.triangles[0] == 1 && mesh.triangles[1] == 0 && mesh.triangles[2] == 2);
    CHECK(mesh.uvs && mesh.uvs[2] == .25f && mesh.uvs[3] == .5f && mesh.uvs[4] == 1);
    itn_mesh_free(&mesh);
    expect_refusal("", 0, "with a face");
    expect_refusal(SQUARE, 0, "with a face");
    expect_refusal(SQUARE "f 1 2\n", 0, "with a face"); /* lines and points are let go */
    expect_mesh(SQUARE "f\nf 1\nf 1 2 3\nf 3 4\n", 4, 1, 0);
    expect_refusal(SQUARE "f 1 2 3\nf 1 5\n", 6, "'5'");
    expect_refusal(SQUARE "f 1 2 5\n", 5, "'5'");
    expect_refusal(SQUARE "f 1 2 0\n", 5, "'0'");
    expect_refusal(SQUARE "f 1 2 -5\n", 5, "'-5'");
    expect_refusal(SQUARE "f 1 2 3x\n", 5, "'3x'");
    expect_refusal(SQUARE "f 1 2 99999999999999999999999\n", 5, "999");
    expect_refusal(SQUARE "f 1 2 4294967297\n", 5, "429");
    expect_refusal(SQUARE "f 1/1 2 3\n", 5, "'1/1'");
    expect_refusal(SQUARE "f 1//1 2 3\n", 5, "'1//1'");
    expect_refusal(SQUARE "f 1/1/1/1 2 3\n", 5, "'1/1/1/1'");
    expect_refusal("f 1 2 3\n" SQUARE, 1, "'1'");
    expect_refusal("v 0 0\n", 1, "vertex");
    /* of vertices that no face names, and of textures, NaN is let go; else it counts */
    expect_refusal("v 0 0 nan\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", 4, "names vertex 0 ");
    expect_refusal(SQUARE "v 0 0 -Inf\nf 1 2 3\nf 1 3 5\n", 7, "names vertex 4 ");
    expect_refusal("# c\n\nv 0 1,5 0\n", 3, "'1,5'");
    expect_refusal("v 0 0 1e39\n", 1, "'1e39'");
    mesh = mesh_of("v nan 1.#QNAN -nan(ind)\n" SQUARE "f 3 4 5\n", &error);
    CHECK(mesh.vertex_count == 5 && mesh.positions[0] == 1 && mesh.positions[1] == 0);
    itn_mesh_free(&mesh);
    mesh = mesh_of(SQUARE "vt nan inf\nvt 1 -nan(ind)\nf 1/1 2/2 3/2\n", &error);
    CHECK(mesh.uvs && mesh.uvs[0] == 0 && mesh.uvs[1] == 0 && mesh.uvs[2] == 1 && mesh.uvs[3] == 0);
    itn_mesh_free(&mesh);
    expect_refusal(SQUARE "vt 0 x\n", 5, "texture coordinate: 'x'");
    expect_refusal("v 0 \\\n 0 \\\r\n x\n", 3, "'x'");
    expect_mesh("v 0 0 0\nv 1 0 0\nv 0 1 0\ng a \\\n v 5 5 5\nf 1 2 -1\n", 3, 1, 0);
    /* a backslash that ends a name is a part of it: nothing of the next line is lost */
    expect_mesh("mtllib C:\\dir\\\nv 0 0 0\nv 1 0 0\nv 0 1 0\no a\\\nf 1 2 3\ng a b\\\r\nf 1 3 2\n"
                "usemtl m\\\nf 2 3 1\n", 3, 3, 0);
    expect_refusal("g a\\\nf 1 2 3\n", 2, "'1'");
    expect_refusal("v 0 0 1e39\n", 1, "'1e39'");
    expect_refusal("v 0 0 0x1\n", 1, "'0x1'");
    expect_refusal("v 0 0 red\n", 1, "'red'");
    expect_refusal("v 0 0 1,5\n", 1, "'1,5'");
    expect_refusal("\x89PNG\r\n\x1a\n", 0, "with a face");
}

/* Area and sum of |area| of a mesh in the plane z = 0: equal if no triangle is turned over. */
static void planar_area(const itn_mesh *mesh, double *area, double *absolute) {
    int i;
    *area = *absolute = 0;
    for (i = 0; i < mesh->triangle_count; i++) {
        const float *a = mesh->positions + 3 * mesh->triangles[3 * i];
        const float *b = mesh->positions + 3 * mesh->triangles[3 * i + 1];
        const float *c = mesh->positions + 3 * mesh->triangles[3 * i + 2];
        double turn = ((double)(b[0] - a[0]) * (double)(c[1] - a[1]) -
                       (double)(b[1] - a[1]) * (double)(c[0] - a[0])) / 2;
        *area += turn;
        *absolute += fabs(turn);
    }
}

/* A star of 4098 corners is refused, in both formats, a convex polygon of so many is not. */
static void check_large_concave(void) {
    int kind, i;
    for (kind = 0; kind < 3; kind++) {
        itn__buffer text = ITN_ZERO;
        char line[100];
        accountant a;
        if (kind == 2)
            put_text(&text, "ply\nformat ascii 1.0\nelement vertex 4098\nproperty float x\n"
                                 "property float y\nproperty float z\n" PLY_FACE "end_header\n");
        for (i = 0; i < 4098; i++) {
            double angle = 2 * 3.14159265358979 * i / 4098, radius = kind && i % 2 ? .5 : 1;
            snprintf(line, sizeof line, "%s%.9g %.9g 0\n", kind == 2 ? "" : "v ",
                     radius * cos(angle), radius * sin(angle));
            put_text(&text, line);
        }
        put_text(&text, kind == 2 ? "4098" : "f");
        for (i = 0; i < 4098; i++) {
            snprintf(line, sizeof line, " %d", kind == 2 ? i : i + 1);
            put_text(&text, line);
        }
        CHECK(load_checked(1, text.bytes, text.size, 0, &a) ==
              (kind ? ITN_ERROR_UNSUPPORTED : ITN_OK));
        itn__buffer_free(&text);
    }
}

/* A mesh 1 large keeps its shape at 1000 and loses it at 5800000, which is refused. */
static void check_far_mesh(void) {
    static const char *const text[2] = {"v 1000 0 0\nv 1001 0 0\nv 1000 1 0\nf 1 2 3\n",
                                        "v 5800000 0 0\nv 5800001 0 0\nv 5800000 1 0\nf 1 2 3\n"};
    accountant a;
    int k;
    for (k = 0; k < 2; k++)
        CHECK(load_checked(1, (const unsigned char *)text[k], strlen(text[k]), 0, &a) ==
              (k ? ITN_ERROR_FORMAT : ITN_OK));
}

/* A square with a square hole, of which a bridge makes one polygon; its ends are twice in the file,
   the second time perhaps as -0. Then faces of 255 corners without an ear: they are cut in no
   time. */
static void check_bridges(const char *zero) {
    itn__buffer text = ITN_ZERO;
    itn_mesh mesh = ITN_ZERO;
    double area, absolute;
    clock_t start = clock();
    char line[300];
    int i, k;
    snprintf(line, sizeof line,
             "v 0 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nv -2 -2 0\nv %s -2 0\nv %s -1 0\nv -1 -1 0\n"
             "v -1 1 0\nv 1 1 0\nv 1 -1 0\nv 0 -1 0\nf 1 2 3 4 5 6 7 8 9 10 11 12\n", zero, zero);
    CHECK(itn_mesh_from_memory(line, strlen(line), NULL, NULL, &mesh, NULL) == ITN_OK);
    planar_area(&mesh, &area, &absolute);
    CHECK_NEAR(area, 12, 1e-6), CHECK_NEAR(absolute, 12, 1e-6);
    itn_mesh_free(&mesh);
    put_text(&text, "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 1 1 0\n");
    for (k = 0; k < 20; k++) {
        put_text(&text, "f");
        for (i = 0; i < 84; i++) put_text(&text, " 1 2 3");
        put_text(&text, " 1 2 4\n");
    }
    CHECK(itn_mesh_from_memory(text.bytes, text.size, NULL, NULL, &mesh, NULL) == ITN_OK);
    CHECK(mesh.triangle_count == 20 * 253);
    CHECK(clock() - start < CLOCKS_PER_SEC);
    itn_mesh_free(&mesh);
    itn__buffer_free(&text);
}

/* Corners given twice, in a row, do not change how a polygon is cut: an arrow with any of its four
   corners twice or three times, also at the end of the list. */
static void check_twins(void) {
    static const char *const corner[4] = {"0 2", "-2 -1", "0 0", "2 -1"};
    int times, i, k, n;
    for (times = 0; times < 81; times++) {
        char text[400] = "v 9 9 0\n", face[100] = "f";
        itn_mesh mesh = ITN_ZERO;
        double area, absolute;
        int code = times;
        for (i = 0, n = 1; i < 4; i++, code /= 3)
            for (k = 0; k <= code % 3; k++) {
                sprintf(text + strlen(text), "v %s 0\n", corner[i]);
                sprintf(face + strlen(face), " %d", ++n);
            }
        if (times % 2) strcat(face, " 2"); /* the first once more */
        strcat(text, face);
        CHECK(itn_mesh_from_memory(text, strlen(text), NULL, NULL, &mesh, NULL) == ITN_OK);
        planar_area(&mesh, &area, &absolute);
        CHECK(mesh.triangle_count == 2 && area == 4 && absolute == 4);
        itn_mesh_free(&mesh);
    }
}

/* Polygons that are not convex keep their area and turn no triangle over. */
static void check_polygons(double wrong) {
    int n, i;
    for (n = 4; n <= 4096; n = n < 12 ? n + 1 : 2 * n > 4096 && n < 4096 ? 4096 : 2 * n) {
        int kind;
        for (kind = 0; kind < 4; kind++) {
            itn__buffer text = ITN_ZERO;
            char line[100];
            itn_mesh mesh = ITN_ZERO;
            static double px[4096], py[4096];
            double area = 0, absolute, expected = 0;
            for (i = 0; i < n; i++) { /* star, spiral arm, comb, rounded */
                double angle = 2 * 3.14159265358979 * i / n;
                double radius = kind == 0 ? (i % 2 ? .3 : 1) : kind == 1 ? .2 + .8 * i / n : 1;
                px[i] = radius * cos(angle), py[i] = radius * sin(angle);
                if (kind == 2) px[i] = i, py[i] = i % 2 ? 0 : i == 0 || i == n - 1 ? 3 : 1;
                if (kind == 2 && i == n - 1) py[i] = 3;
                snprintf(line, sizeof line, "v %.9g %.9g 0\n", px[i], py[i]);
                put_text(&text, line);
            }
            put_text(&text, "f");
            for (i = 1; i <= n; i++) {
                snprintf(line, sizeof line, " %d", i);
                put_text(&text, line);
            }
            CHECK(itn_mesh_from_memory(text.bytes, text.size, NULL, NULL, &mesh, NULL) == ITN_OK);
            for (i = 0; i < n; i++) {
                int j = (i + 1) % n;
                expected += (px[i] * py[j] - px[j] * py[i]) / 2;
            }
            planar_area(&mesh, &area, &absolute);
            CHECK(mesh.triangle_count == n - 2);
            CHECK_NEAR(area, expected * wrong, 1e-5 * fabs(expected));
            CHECK_NEAR(absolute, fabs(area), 1e-6 * fabs(area));
            itn_mesh_free(&mesh);
            itn__buffer_free(&text);
        }
    }
    check_large_concave(), check_far_mesh();
    check_bridges("0"), check_bridges("-0.0");
    check_twins();
    /* a square in each plane, an L, a bow that crosses itself, one with all corners equal */
    expect_mesh("v 0 0 0\nv 0 1 0\nv 0 1 1\nv 0 0 1\nf 1 2 3 4\nf 4 3 2 1", 4, 4, 0);
    expect_mesh("v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nf 1 2 3 4 5 6", 6, 4, 0);
    expect_mesh("v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4", 4, 2, 0);
    expect_mesh("v 1 1 1\nf 1 1 1 1 1 1 1\n", 1, 1, 0);
}

/* ---- PLY ---- */

static void test_ply_ascii(void) {
    itn_error error;
    itn_mesh mesh;
    expect_mesh(PLY_HEADER("ascii", PLY_VERTEX PLY_FACE) "0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n", 3, 1, 0);
    expect_mesh(PLY_HEADER("ascii", PLY_VERTEX PLY_FACE) "0 0 0\n1 0 0\n1 1 0\n3 0 1 2", 3, 1, 0);
    expect_mesh("ply\r\nformat ascii 1.0\r\ncomment C:\\dir\\\r\nelement vertex 3\r\nproperty "
                "double x\r\nproperty float64 y\r\nproperty short z\r\nproperty uchar red\r\n"
                "element face 2\r\nproperty int flags\r\nproperty list uint8 uint32 vertex_index"
                "\r\nelement edge 1\r\nproperty int a\r\nproperty list int float b\r\n"
                "end_header\r\n"
                "0 0 0 9\r\n1 0 0 9\r\n1 1 0 nan\r\n7 3 0 1 2\r\n7 4 0 1 2 1\r\n1 2 3 4\r\n",
                3, 3, 0);
    mesh = mesh_of(PLY_HEADER("ascii", "obj_info x\nelement camera 1\nproperty list char float p\n"
                              "element vertex 3\nproperty float s\nproperty float t\n"
                              "property float z\nproperty float y\nproperty float x\n" PLY_FACE)
                   "2 5 5\n.1 .2 3 2 1\n.3 .4 6 5 4\n.5 .6 9 8 7\n3 2 1 0\n", &error);
    CHECK(mesh.vertex_count == 3 && mesh.positions[0] == 1 && mesh.positions[2] == 3);
    CHECK(mesh.triangles[0] == 2 && mesh.uvs && mesh.uvs[0] == .5f && mesh.uvs[5] == .2f);
    itn_mesh_free(&mesh);
    mesh = mesh_of(PLY_HEADER("ascii", PLY_VERTEX PLY_FACE "property list uchar float texcoord\n")
                   "0 0 0\n1 0 0\n1 1 0\n3 0 1 2 6 1 2 3 4 5 6\n", &error);
    CHECK(mesh.uvs && mesh.uvs[0] == 1 && mesh.uvs[5] == 6);
    itn_mesh_free(&mesh);
    /* a face with texture coordinates and one without: no uvs, rather than another face's */
    expect_mesh("ply\nformat ascii 1.0\n" PLY_VERTEX "element face 2\n"
                "property list uchar int vertex_indices\nproperty list uchar float texcoord\n"
                "end_header\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2 6 1 2 3 4 5 6\n3 2 1 0 0\n", 3, 2, 0);
    /* a byte order mark, and blanks behind "ply" and other words */
    expect_mesh("\xef\xbb\xbf" PLY_HEADER("ascii", PLY_VERTEX PLY_FACE)
                "0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n", 3, 1, 0);
    expect_mesh("ply \nformat ascii 1.0 \n" PLY_VERTEX PLY_FACE "end_header \n"
                "0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n", 3, 1, 0);
    /* texture coordinates that stand before the corners they are for */
    mesh = mesh_of(PLY_HEADER("ascii", PLY_VERTEX "element face 1\n"
                              "property list uchar float texcoord\n"
                              "property list uchar int vertex_indices\n")
                   "0 0 0\n1 0 0\n1 1 0\n6 1 2 3 4 5 6 3 0 1 2\n", &error);
    CHECK(mesh.uvs && mesh.uvs[0] == 1 && mesh.uvs[5] == 6);
    itn_mesh_free(&mesh);
    expect_refusal(PLY_HEADER("ascii", PLY_VERTEX PLY_FACE "property list uchar float texcoord\n")
                   "0 0 0\n1 0 0\n1 1 0\n3 0 1 2 4 1 2 3 4\n", 14, "per corner");
    mesh = mesh_of(PLY_HEADER("ascii", PLY_VERTEX "property float u\nproperty float v\n" PLY_FACE)
                   "0 0 0 nan 1\n1 0 0 0 inf\n1 1 0 0 0\n3 0 1 2\n", &error);
    CHECK(mesh.uvs && mesh.uvs[0] == 0 && mesh.uvs[1] == 1 && mesh.uvs[3] == 0);
    itn_mesh_free(&mesh);
    expect_refusal(PLY_HEADER("ascii", PLY_VERTEX PLY_FACE) "0 0 0\n1 nan 0\n1 1 0\n3 0 1 2\n", 13,
                   "face 0: names vertex 1 ");
    expect_refusal("ply\n", 2, "no end");
    expect_refusal("ply\nformat ascii 1.0\n" PLY_VERTEX PLY_FACE "end_header x\n", 9, "no end");
    expect_refusal("ply\nformat ascii 1.0\nend_header\n", 3, "no vertex");
    expect_refusal("ply\nelement vertex 1\nend_header\n", 3, "no format");
    expect_refusal("ply\nformat ascii 1.0\nelement face 1\nelement face 1\n", 4, "twice");
    expect_refusal("ply\nformat weird 1.0\nend_header\n", 2, "format");
    expect_refusal("ply\nformat ascii 2.0\nend_header\n", 2, "format");
    expect_refusal("ply\nformat ascii 1.0\nwhat\nend_header\n", 3, "keyword");
    expect_refusal("ply\nformat ascii 1.0\nproperty int x\n", 3, "before any element");
    expect_refusal("ply\nformat ascii 1.0\nelement vertex x\n", 3, "count");
    expect_refusal("ply\nformat ascii 1.0\nelement vertex -1\n", 3, "count");
    expect_refusal("ply\nformat ascii 1.0\nelement vertex 99999999999999999999999\n", 3, "count");
    expect_refusal("ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\n", 4, "type");
    expect_refusal("ply\nformat ascii 1.0\nelement vertex 1\nproperty list float int x\n", 4,
                   "no integer");
    expect_refusal(PLY_HEADER("ascii", PLY_FACE PLY_VERTEX) "3 0 1 2\n0 0 0\n1 0 0\n1 1 0\n", 5,
                   "before the vertices");
    expect_refusal(PLY_HEADER("ascii", PLY_VERTEX PLY_FACE) "0 0 0\n1 0 0\n1 1 0\n3 0 1 3\n", 13,
                   "face 0");
    expect_refusal(PLY_HEADER("ascii", PLY_VERTEX PLY_FACE) "0 0 0\n1 0 0\n1 1 0\n3 0 1 -1\n", 13,
                   "does not exist");
    expect_refusal(PLY_HEADER("ascii", PLY_VERTEX PLY_FACE) "0 0 0\n1 0 0\n1 1 0\n2 0 1  \n", 0,
                   "with a face"); /* a line */
}

/* Strips: the corners of each triangle in order, every other one turned round, from the start of a
   strip on. The triangles are those of the same square as faces. */
static void check_ply_strips(int restart) {
    static const int expected[9] = {0, 1, 2, 2, 1, 3, 3, 1, 0};
    itn_error error;
    char text[400];
    snprintf(text, sizeof text, PLY_HEADER("ascii", "element vertex 4\nproperty float x\n"
             "property float y\nproperty float z\nelement tristrips 1\n"
             "property list int int vertex_indices\n")
             "0 0 0\n1 0 0\n0 1 0\n1 1 0\n10 0 -1 0 1 2 3 %d 3 1 0\n", restart);
    itn_mesh mesh = mesh_of(text, &error);
    CHECK(mesh.triangle_count == 3);
    CHECK(mesh.triangle_count == 3 && !memcmp(mesh.triangles, expected, sizeof expected));
    itn_mesh_free(&mesh);
    expect_refusal(PLY_HEADER("ascii", PLY_VERTEX "element tristrips 1\n"
                              "property list int int vertex_indices\n")
                   "0 0 0\n1 0 0\n1 1 0\n4 0 1 2 -2\n", 13, "does not exist");
}

/* Bytes of a number in either order. */
static void put_ordered(itn__buffer *b, const void *number, size_t size, int big) {
    size_t i;
    for (i = 0; i < size; i++) itn__put(b, (const char *)number + (big ? size - 1 - i : i), 1);
}

/* A binary tetrahedron with properties of all types around the ones that count. */
static itn__buffer make_ply(int big) {
    itn__buffer b = ITN_ZERO;
    int i, k;
    int16_t s = -3;
    uint16_t us = 65533;
    int32_t n = -7;
    double d;
    float f;
    put_text(&b, "ply\nformat ");
    put_text(&b, big ? "binary_big_endian" : "binary_little_endian");
    put_text(&b, " 1.0\nelement vertex 4\nproperty short a\nproperty double x\n"
                      "property list ushort int skipped\nproperty float y\nproperty char z\n"
                      "element nothing 5\nelement face 4\nproperty ushort b\n"
                      "property list int uint vertex_indices\nproperty double c\nend_header\n");
    for (i = 0; i < 4; i++) {
        us = (uint16_t)i;
        d = i == 1, f = i == 2;
        put_ordered(&b, &s, 2, big);
        put_ordered(&b, &d, 8, big);
        put_ordered(&b, &us, 2, big);
        for (k = 0; k < i; k++) put_ordered(&b, &n, 4, big);
        put_ordered(&b, &f, 4, big);
        put_u8(&b, i == 3 ? 255 : 0); /* -1 */
    }
    for (i = 0; i < 4; i++) {
        int32_t count = 3;
        put_ordered(&b, &us, 2, big);
        put_ordered(&b, &count, 4, big);
        for (k = 0; k < 3; k++) {
            uint32_t index = (uint32_t)((i + k) % 4);
            put_ordered(&b, &index, 4, big);
        }
        d = 1e300;
        put_ordered(&b, &d, 8, big);
    }
    return b;
}

static void check_ply_binary(float wrong) {
    int big;
    for (big = 0; big < 2; big++) {
        itn__buffer b = make_ply(big);
        itn_mesh mesh = ITN_ZERO;
        itn_error error = ITN_ZERO;
        CHECK(itn_mesh_from_memory(b.bytes, b.size, "t.ply", NULL, &mesh, &error) == ITN_OK);
        if (mesh.positions) {
            CHECK(mesh.vertex_count == 4 && mesh.triangle_count == 4 && !mesh.uvs);
            CHECK(mesh.positions[3] == wrong && mesh.positions[7] == 1 && mesh.positions[11] == -1);
            CHECK(mesh.triangles[3] == 1 && mesh.triangles[11] == 1);
        }
        itn_mesh_free(&mesh);
        if (wrong == 1) abuse(1, b.bytes, b.size, 6000, 1);
        itn__buffer_free(&b);
    }
}

static void test_ply_lies(void) {
    static const char *const lies[] = {
        PLY_HEADER("binary_little_endian", "element vertex 2000000000\nproperty float x\n"
                   "property float y\nproperty float z\n" PLY_FACE) "0000000000",
        PLY_HEADER("ascii", "element vertex 2000000000\nproperty float x\n"
                   "property float y\nproperty float z\n" PLY_FACE) "0000000000",
        PLY_HEADER("ascii", "element other 9000000000000000000\nproperty int a\n" PLY_VERTEX
                   PLY_FACE) "0 0 0\n",
        PLY_HEADER("binary_big_endian", PLY_VERTEX "element face 1\nproperty list uint char "
                   "vertex_indices\n") "aaaabbbbccccaaaabbbbccccaaaabbbbcccc\xff\xff\xff\xff....."};
    size_t i;
    accountant a;
    for (i = 0; i < sizeof lies / sizeof *lies; i++) {
        CHECK(load_checked(1, (const unsigned char *)lies[i], strlen(lies[i]), 0, &a) ==
              ITN_ERROR_FORMAT);
        CHECK(a.largest < 4096);
    }
}

static void check_ply_round_trip(int damage) {
    int with_uvs, i;
    for (with_uvs = 0; with_uvs < 2; with_uvs++) {
        itn_mesh mesh = ITN_ZERO, back = ITN_ZERO;
        const char *path = in_directory("mesh.ply");
        itn_mesh_create(50, 90, with_uvs, NULL, &mesh, NULL);
        for (i = 0; i < 150; i++) mesh.positions[i] = (float)random_bits() * 1e-7f - 200;
        for (i = 0; i < 270; i++) mesh.triangles[i] = (int)(random_bits() % 50);
        for (i = 0; with_uvs && i < 540; i++) mesh.uvs[i] = (float)random_bits() * 1e-9f;
        CHECK(itn_mesh_save_ply(&mesh, path, NULL) == ITN_OK);
        if (CHECK(itn_mesh_load(path, NULL, &back, NULL) == ITN_OK)) {
            back.positions[149] += (float)damage;
            CHECK(back.vertex_count == 50 && back.triangle_count == 90);
            CHECK(!memcmp(mesh.positions, back.positions, 600));
            CHECK(!memcmp(mesh.triangles, back.triangles, 1080));
            CHECK(!with_uvs == !back.uvs && (!with_uvs || !memcmp(mesh.uvs, back.uvs, 2160)));
        }
        itn_mesh_free(&back);
        mesh.triangles[5] = 50;
        CHECK(itn_mesh_save_ply(&mesh, path, NULL) == ITN_ERROR_ARGUMENT);
        mesh.triangles[5] = 0, mesh.positions[6] = NAN;
        CHECK(itn_mesh_save_ply(&mesh, path, NULL) == ITN_ERROR_ARGUMENT);
        itn_mesh_free(&mesh);
        CHECK(itn_mesh_save_ply(&mesh, path, NULL) == ITN_ERROR_ARGUMENT);
    }
}

/* ---- damage, memory, disk ---- */

static void test_text_abuse(void) {
    static const char *const texts[] = {
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0 # c\nvt 0 .5\nvn 0 0 1\r\nf 1/1/1 2/1/1 \\\n3/1/1 "
        "4/1/1\nf -1 -2 -3\n",
        PLY_HEADER("ascii", PLY_VERTEX "property float u\nproperty float v\n" PLY_FACE
                   "property list uchar float texcoord\n")
        "0 0 0 1 2\n1 0 0 1 2\n1 1 0 1 2\n3 0 1 2 6 1 2 3 4 5 6\n"};
    size_t i;
    for (i = 0; i < 2; i++)
        abuse(1, (const unsigned char *)texts[i], strlen(texts[i]), 10000, 0);
    abuse(0, (const unsigned char *)"Pf\n2 2\n-1.0\n0123456789abcdef", 28, 5000, 1);
}

/* Every saver with memory failing at every call: an error, no leak, the old file whole. */
static void test_save_memory(void) {
    int kind;
    for (kind = 0; kind < 5; kind++) {
        accountant a = ITN_ZERO;
        itn_context context = count_context(&a);
        itn_image image = random_image(9, 5, 3, &context);
        itn_mesh mesh = ITN_ZERO;
        itn_result result = ITN_ERROR_MEMORY;
        long live, k;
        const char *path = in_directory("old");
        itn_mesh_create(3, 1, 1, &context, &mesh, NULL);
        live = a.live;
        for (k = 1; result == ITN_ERROR_MEMORY && k < 100; k++) {
            char text[4] = "";
            FILE *file;
            CHECK(write_file(path, "old", 3, NULL) == ITN_OK);
            a.calls = 0, a.fail_at = k;
            result = kind == 0   ? itn_image_save_exr(&image, path, NULL)
                     : kind == 1 ? itn_image_save_pfm(&image, 0, 3, path, NULL)
                     : kind == 2 ? itn_image_save_png(&image, 0, 3, ITN_PNG_TONE, 0, path, NULL)
                     : kind == 3 ? itn_image_save_png(&image, 0, 1, ITN_PNG_SIGNED, 1, path, NULL)
                                 : itn_mesh_save_ply(&mesh, path, NULL);
            CHECK(a.live == live);
            file = fopen(path, "rb");
            CHECK(file && fread(text, 1, 3, file) == 3 && (!result || !strcmp(text, "old")));
            if (file) fclose(file);
            CHECK(result == ITN_OK || result == ITN_ERROR_MEMORY);
        }
        CHECK(result == ITN_OK && k > 2);
        a.fail_at = 0;
        itn_image_free(&image);
        itn_mesh_free(&mesh);
        CHECK(a.live == 0);
    }
    { /* the same for reading a file */
        accountant a = ITN_ZERO;
        itn_context context = count_context(&a);
        itn_image image = ITN_ZERO;
        itn_result result = ITN_ERROR_MEMORY;
        long k;
        check_exr_round_trip(0);
        for (k = 1; result == ITN_ERROR_MEMORY && k < 100; k++) {
            a.calls = 0, a.fail_at = k;
            result = itn_image_load(in_directory("image.exr"), &context, &image, NULL);
            CHECK(result == ITN_OK || a.live == 0);
        }
        CHECK(result == ITN_OK && k > 3);
        itn_image_free(&image);
        CHECK(a.live == 0);
    }
}

/* How many temporaries lie beside a file. */
static int temporaries(const char *path) {
    char name[200];
    int k, found = 0;
    for (k = 0; k < 4; k++) {
        snprintf(name, sizeof name, "%s.tmp%d", path, k);
        found += access(name, F_OK) == 0;
    }
    return found;
}

static int is_precious(const char *path) {
    itn__buffer file = ITN_ZERO;
    int is = itn__read_file(path, 8, NULL, &file, NULL) == ITN_OK && file.size == 8 &&
             !memcmp(file.bytes, "precious", 8);
    itn__buffer_free(&file);
    return is;
}

/* Files of so many bytes at most, as on a disk that is nearly full; -1: of any size. */
static void limit_files(int most) {
    static struct rlimit before;
    struct rlimit limit;
    if (most >= 0) getrlimit(RLIMIT_FSIZE, &before);
    limit = before;
    if (most >= 0) limit.rlim_cur = (rlim_t)most;
    signal(SIGXFSZ, most >= 0 ? SIG_IGN : SIG_DFL);
    CHECK(setrlimit(RLIMIT_FSIZE, &limit) == 0);
}

static void test_disk(void) {
    itn_image image = random_image(40, 40, 3, NULL);
    itn_error error = ITN_ZERO;
    const char *old = in_directory("kept.exr");
    char taken[200], *path;
    itn__buffer file = ITN_ZERO;
    CHECK(itn_image_save_exr(&image, "/nowhere/at/all.exr", &error) == ITN_ERROR_FILE);
    CHECK(strstr(error.message, "/nowhere/at/all.exr") != NULL);
    CHECK(write_file(old, "precious", 8, &error) == ITN_OK);
    if (!access("/dev/full", W_OK)) {
        CHECK(itn_image_save_exr(&image, "/dev/full", &error) == ITN_ERROR_FILE);
        CHECK(itn_image_save_pfm(&image, 0, 1, "/dev/full", &error) == ITN_ERROR_FILE);
        CHECK(write_file("/dev/full", "x", 1, &error) == ITN_ERROR_FILE);
        CHECK(!access("/dev/full", W_OK));
    }
    CHECK(write_file("/dev/null", "x", 1, &error) == ITN_OK);
    limit_files(300);
    CHECK(itn_image_save_exr(&image, old, &error) == ITN_ERROR_FILE);
    limit_files(-1);
    CHECK(strstr(error.message, "cannot write") && !temporaries(old) && is_precious(old));
    CHECK(itn__read_file(old, 7, NULL, &file, &error) == ITN_ERROR_FILE && !file.bytes);
    CHECK(itn_image_save_exr(&image, directory, &error) == ITN_ERROR_FILE); /* a directory */
    CHECK(!temporaries(directory));
    /* a temporary of somebody else's, also a link, is neither written to nor removed */
    snprintf(taken, sizeof taken, "%s.tmp0", old);
    CHECK(!symlink(in_directory("mesh.ply"), taken) && temporaries(old) == 1);
    CHECK(write_file(old, "precious", 8, &error) == ITN_OK && is_precious(old));
    CHECK(temporaries(old) == 1 && !is_precious(in_directory("mesh.ply")) && !unlink(taken));
    path = (char *)malloc(5000);
    memset(path, 'a', 4999), path[4999] = 0;
    CHECK(write_file(path, "x", 1, &error) == ITN_ERROR_ARGUMENT);
    free(path);
    CHECK(itn_image_save_exr(&image, old, &error) == ITN_OK && !temporaries(old));
    itn_image_free(&image);
}

/* The system's calls on the way to a new file, in their order: s syncs the file with all its bytes,
   p with a part of them, r renames, d syncs a folder. */
static char calls[20];
static int sync_fails;
int fsync(int file) {
    struct stat state;
    int known = fstat(file, &state) == 0;
    strncat(calls, known && S_ISDIR(state.st_mode) ? "d" : known && state.st_size == 8 ? "s" : "p",
            sizeof calls - 1 - strlen(calls));
    errno = EIO;
    return sync_fails ? -1 : 0;
}
int rename(const char *from, const char *to) {
    strncat(calls, "r", sizeof calls - 1 - strlen(calls));
    return renameat(AT_FDCWD, from, AT_FDCWD, to);
}

static void check_power_loss(const char *order) {
    const char *old = in_directory("kept.exr");
    char here[200];
    itn_error error = ITN_ZERO;
    CHECK(write_file(old, "precious", 8, &error) == ITN_OK);
    calls[0] = 0;
    CHECK(write_file(old, "precious", 8, &error) == ITN_OK && !strcmp(calls, order));
    sync_fails = 1, calls[0] = 0;
    CHECK(write_file(old, "new", 3, &error) == ITN_ERROR_FILE && !strcmp(calls, "p"));
    sync_fails = 0, calls[0] = 0;
    CHECK(is_precious(old) && !temporaries(old));
    if (CHECK(getcwd(here, sizeof here) && !chdir(directory))) { /* a path without a folder */
        CHECK(write_file("kept.exr", "precious", 8, &error) == ITN_OK);
        CHECK(!strcmp(calls, "srd") && !chdir(here));
    }
}

/* Processes that write the same file at the same time, again and again: what can be read is always
   one of theirs, whole. `torn`: what is read is changed, as if two had written into one. */
static void check_writers(int torn) {
    enum { WRITERS = 4, TIMES = 50, SIZE = 100000 };
    const char *path = in_directory("old");
    unsigned char *bytes = (unsigned char *)malloc(SIZE);
    int k, i, status, whole = 1, done = 0, left = WRITERS;
    fflush(stdout);
    memset(bytes, 'a', SIZE);
    CHECK(write_file(path, bytes, SIZE, NULL) == ITN_OK);
    for (k = 0; k < WRITERS; k++) {
        if (fork()) continue;
        memset(bytes, 'a' + k, SIZE);
        for (i = 0; i < TIMES && write_file(path, bytes, SIZE, NULL) == ITN_OK;) i++;
        _exit(i != TIMES);
    }
    while (left > 0) {
        itn__buffer file = ITN_ZERO;
        if (waitpid(-1, &status, WNOHANG) > 0) left--, done += status == 0;
        whole &= itn__read_file(path, SIZE, NULL, &file, NULL) == ITN_OK && file.size == SIZE;
        if (file.size && torn) file.bytes[file.size / 2] ^= 1;
        for (i = 1; whole && i < SIZE; i++) whole = file.bytes[i] == file.bytes[0];
        itn__buffer_free(&file);
    }
    CHECK(whole && done == WRITERS && !temporaries(path));
    free(bytes);
}

/* A disk that is full after any number of bytes: the file is the old one or, where all of it fits,
   the new one. fits: a planted error of how many. */
static itn_result save_any(int kind, const itn_image *image, const itn_net *net, const char *path) {
    static float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static int face[3] = {0, 1, 2};
    itn_mesh mesh = ITN_ZERO;
    mesh.positions = corners, mesh.triangles = face, mesh.vertex_count = 3, mesh.triangle_count = 1;
    if (kind == 0) return itn_image_save_exr(image, path, NULL);
    if (kind == 1) return itn_image_save_pfm(image, 0, 3, path, NULL);
    if (kind == 2) return itn_image_save_png(image, 0, 3, ITN_PNG_TONE, 1, path, NULL);
    if (kind == 3) return itn_mesh_save_ply(&mesh, path, NULL);
    return itn_net_save(net, path, 0, NULL);
}
static void check_full_disk(int fits) {
    const char *path = in_directory("kept.exr");
    itn_image image = random_image(5, 4, 3, NULL);
    itn_net_desc desc = ITN_ZERO;
    itn_net *net = NULL;
    struct stat state;
    int times = 0;
    desc.width = desc.height = 4, desc.layer_count = desc.outputs = 1, desc.first_channels = 2;
    desc.channels = 1;
    CHECK(itn_net_create(&desc, NULL, &net, NULL) == ITN_OK);
    for (int kind = 0; kind < 5; kind++) {
        CHECK(save_any(kind, &image, net, path) == ITN_OK && !stat(path, &state));
        for (int size = (int)state.st_size, most = 0; most <= size; most += 1 + size / 40, times++) {
            if (most > size - 1 - size / 40) most = size;
            CHECK(write_file(path, "precious", 8, NULL) == ITN_OK);
            limit_files(most);
            itn_result result = save_any(kind, &image, net, path);
            limit_files(-1);
            CHECK(result == (most + fits < size ? ITN_ERROR_FILE : ITN_OK));
            CHECK(result ? is_precious(path) : !stat(path, &state) && state.st_size == size);
            CHECK(!temporaries(path));
        }
    }
    printf("  a disk that is full: %d times, the old file each time\n", times);
    itn_net_free(net), itn_image_free(&image);
}

/* Programs that are killed while they write: the file is the one before or the one after, and who
   writes next is not in the way of what they left. */
static void check_killed(int torn) {
    enum { TIMES = 30, SIZE = 300000 };
    const char *path = in_directory("old");
    unsigned char *bytes = (unsigned char *)malloc(SIZE);
    char name[200];
    int left = 0;
    fflush(stdout);
    memset(bytes, 'a', SIZE);
    for (int k = 0; k < TIMES; k++) {
        itn__buffer file = ITN_ZERO;
        struct timespec wait = {0, (long)(random_bits() % 2000000)};
        CHECK(write_file(path, bytes, SIZE, NULL) == ITN_OK);
        pid_t child = fork();
        while (!child) memset(bytes, ++bytes[0], SIZE), write_file(path, bytes, SIZE, NULL);
        nanosleep(&wait, NULL);
        CHECK(!kill(child, SIGKILL) && waitpid(child, NULL, 0) == child);
        int whole = itn__read_file(path, SIZE, NULL, &file, NULL) == ITN_OK && file.size == SIZE;
        if (whole && torn) file.bytes[SIZE / 2] ^= 1;
        for (int i = 1; whole && i < SIZE; i++) whole = file.bytes[i] == file.bytes[0];
        CHECK(whole);
        itn__buffer_free(&file);
        for (int i = 0; i < 4; i++) {
            snprintf(name, sizeof name, "%s.tmp%d", path, i);
            if (k == TIMES - 1 || i) left += !unlink(name);
        }
    }
    printf("  killed while writing: %d times, a whole file each time, %d temporaries left\n",
           (int)TIMES, left);
    free(bytes);
}

/* Signals all the time, which interrupt system calls: pictures and files are as without. */
static volatile sig_atomic_t alarms;
static const struct itimerval no_timer = {{0, 0}, {0, 0}};
static void count_alarm(int signal) { (void)signal, alarms++; }
static void check_signals(int planted) {
    static const char text[] = "film width 8 height 8\ncamera eye 0 1 4 target 0 0 0\n"
                               "surface s type diffuse reflectance .5\nobject plane surface s\n"
                               "light constant radiance 1\n";
    const char *path = in_directory("image.exr");
    struct sigaction action, before;
    struct itimerval often = {{0, 200}, {0, 200}};
    itn_scene *scene = NULL;
    itn_image first = ITN_ZERO, image = ITN_ZERO, read = ITN_ZERO;
    int times = 0;
    CHECK(!itn_scene_from_memory(text, sizeof text - 1, NULL, NULL, 0, NULL, &scene, NULL));
    CHECK(!itn_render(scene, NULL, NULL, NULL, 0, &first, NULL));
    first.pixels[5] += (float)planted;
    memset(&action, 0, sizeof action), action.sa_handler = count_alarm; /* not SA_RESTART */
    CHECK(!sigaction(SIGALRM, &action, &before) && !setitimer(ITIMER_REAL, &often, NULL));
    for (alarms = 0; alarms < 200; times++) {
        CHECK(!itn_render(scene, NULL, NULL, NULL, 0, &image, NULL));
        CHECK(!itn_image_save_exr(&image, path, NULL) && !itn_image_load(path, NULL, &read, NULL));
        const float *y = itn_image_plane(&read, "Y"), *made = itn_image_plane(&image, "Y");
        CHECK(y && made && !memcmp(y, made, 64 * sizeof *y));
        CHECK(made && !memcmp(itn_image_plane(&first, "Y"), made, 64 * sizeof *y));
        itn_image_free(&image), itn_image_free(&read);
    }
    CHECK(!setitimer(ITIMER_REAL, &no_timer, NULL) && !sigaction(SIGALRM, &before, NULL));
    printf("  signals: %d, while %d pictures were made, written and read: the same bits\n",
           (int)alarms, times);
    itn_image_free(&first), itn_scene_free(scene);
}

static void remove_directory(void) {
    static const char *const names[] = {"image.exr", "image.pfm", "image.png", "n.png",
                                        "mesh.ply",  "kept.exr",  "old"};
    size_t i;
    for (i = 0; i < sizeof names / sizeof *names; i++) remove(in_directory(names[i]));
    CHECK(rmdir(directory) == 0); /* nothing else was left in it */
}

/* ---- what searches for bad bytes have kept ---- */

static int fuzz_leak;
static void fuzz_again(const char *kind, int number, const unsigned char *bytes, size_t size) {
    int before = check_failed;
    fuzz_one(kind, bytes, size, fuzz_leak);
    if (check_failed > before) printf("  by line %d of corpus/%s.txt\n", number + 1, kind);
}
static void check_corpora(int leak) {
    static const char *const kinds[] = {"scene", "obj", "ply", "exr", "pfm", "png", "net", "desc"};
    fuzz_leak = leak;
    for (int k = 0; k < 8; k++) CHECK(fuzz_corpus(kinds[k], fuzz_again) >= 20);
}

int main(void) {
    strcpy(directory, "/tmp/itn-files-XXXXXX");
    if (!mkdtemp(directory)) return printf("no temporary directory\n"), 1;
    check_numbers(1);
    CHECK_CATCHES(check_numbers(1 + 3e-16));
    check_printing('.');
    CHECK_CATCHES(check_printing(','));
    test_inflate();
    test_long_codes();
    test_repeated_lengths();
    check_deflate(0);
    CHECK_CATCHES(check_deflate(1));
    check_exr_round_trip(0);
    CHECK_CATCHES(check_exr_round_trip(1));
    check_pfm_round_trip(0);
    CHECK_CATCHES(check_pfm_round_trip(1));
    test_pfm_variants();
    test_exr_variants();
    test_half();
    test_exr_limits();
    test_exr_lies();
    test_exr_shared_bytes(0);
    CHECK_CATCHES(test_exr_shared_bytes(1));
    test_exr_damaged_block();
    check_exr_empty_table(0, 0);
    check_exr_empty_table(1, 0);
    CHECK_CATCHES(check_exr_empty_table(0, 1));
    check_exr_windows(0);
    CHECK_CATCHES(check_exr_windows(1));
    test_image_arguments();
    check_png(1);
    CHECK_CATCHES(check_png(1.02f));
    test_png_shapes();
    check_png_wide(0);
    CHECK_CATCHES(check_png_wide(1));
    check_png_types(0);
    CHECK_CATCHES(check_png_types(1));
    test_png_damage();
    check_png_curves(0);
    CHECK_CATCHES(check_png_curves(1));
    test_other_formats();
    check_photo_means(0);
    CHECK_CATCHES(check_photo_means(1));
    check_photo_noise(1);
    CHECK_CATCHES(check_photo_noise(1.05));
    test_photo_masks();
    test_photo_refusals();
    test_obj();
    CHECK_CATCHES(expect_mesh(SQUARE "f 1 2 3 4\n", 4, 3, 0));
    CHECK_CATCHES(expect_refusal(SQUARE "f 1 2 5\n", 6, "'5'"));
    check_polygons(1);
    CHECK_CATCHES(check_polygons(1.001));
    test_ply_ascii();
    check_ply_strips(-1);
    CHECK_CATCHES(check_ply_strips(2));
    check_ply_binary(1);
    CHECK_CATCHES(check_ply_binary(2));
    test_ply_lies();
    check_ply_round_trip(0);
    CHECK_CATCHES(check_ply_round_trip(1));
    test_text_abuse();
    test_save_memory();
    test_disk();
    check_power_loss("srd");
    CHECK_CATCHES(check_power_loss("rsd"));
    check_full_disk(0);
    CHECK_CATCHES(check_full_disk(100));
    limit_files(-1);
    check_killed(0);
    CHECK_CATCHES(check_killed(1));
    check_signals(0);
    CHECK_CATCHES(check_signals(1));
    setitimer(ITIMER_REAL, &no_timer, NULL);
    check_writers(0);
    CHECK_CATCHES(check_writers(1));
    check_corpora(0);
    CHECK_CATCHES(check_corpora(1));
    remove_directory();
    return check_end("files");
}
