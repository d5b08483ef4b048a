/* A t-shirt on somebody who lifts an arm: one line a frame with its lowest, highest and mean height [m] and how much
 * its normals look forwards in the mean, and at the end the time a frame took, on stderr.
 *
 *   wave [MODEL.muslin]      else the wardrobe's t-shirt
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "muslin.h"

enum { FRAMES = 30 };

static void *read_all(const char *path, size_t *n)
{
    FILE *file = fopen(path, "rb");
    char *bytes = NULL;
    long size;
    if (file && !fseek(file, 0, SEEK_END) && (size = ftell(file)) >= 0) {
        rewind(file);
        bytes = malloc((size_t)size + 1);
        *n = bytes ? fread(bytes, 1, (size_t)size, file) : 0;
    }
    if (file)
        fclose(file);
    return bytes;
}

static uint32_t find(const muslin_garment *garment, const char *name)
{
    for (uint32_t b = 0; b < muslin_bones(garment); b++)
        if (!strcmp(muslin_bone_name(garment, b), name))
            return b;
    return MUSLIN_NONE;
}

int main(int count, char **words)
{
    char error[512];
    size_t n = 0;
    void *model = count > 1 ? read_all(words[1], &n) : NULL;
    muslin_wear wear = { 0 };
    wear.garment = "tee";
    wear.fabric = "silk-charmeuse";
    wear.size = "L";
    wear.height = 1.72;
    if (count > 1 && !model) {
        fprintf(stderr, "%s: cannot be read\n", words[1]);
        return 3;
    }
    muslin_garment *garment = muslin_open(model, n, &wear, error, sizeof error);
    free(model);
    if (!garment) {
        fprintf(stderr, "%s\n", error);
        return 4;
    }
    uint32_t bones = muslin_bones(garment), verts = muslin_vertices(garment);
    uint32_t arm = find(garment, "upperarm01.L");
    float *turns = calloc(bones, 4 * sizeof *turns);
    float *at = calloc(verts, 3 * sizeof *at), *normals = calloc(verts, 3 * sizeof *normals);
    float root[3] = { 0, 0, 0 };
    if (!turns || !at || !normals || arm == MUSLIN_NONE)
        return 1;
    for (uint32_t b = 0; b < bones; b++)
        turns[4 * b + 3] = 1;
    const uint32_t *corners = muslin_corners(garment);
    for (uint32_t k = 0; k < 3 * muslin_triangles(garment); k++)
        if (corners[k] >= verts)
            return 1;
    for (uint32_t b = 0; b < bones; b++) {
        uint32_t parent = muslin_bone_parent(garment, b);
        float joint[3] = { 0, -9, 0 };
        muslin_bone_joint(garment, b, joint);
        if ((b == 0) != (parent == MUSLIN_NONE) || (b > 0 && parent >= b) || !(joint[1] > -2 && joint[1] < 2))
            return 1;
    }
    muslin_begin(garment, 1.0f / 30);
    clock_t spent = 0;
    for (int k = 0; k < FRAMES; k++) {
        /* About z, from the side up. */
        turns[4 * arm + 2] = 0.5f * k / FRAMES;
        clock_t since = clock();
        if (muslin_frame_with_normals(garment, turns, root, at, normals))
            return 6;
        spent += clock() - since;
        float low = at[1], high = at[1];
        double sum = 0, forwards = 0;
        for (uint32_t v = 0; v < verts; v++) {
            float y = at[3 * v + 1];
            low = y < low ? y : low;
            high = y > high ? y : high;
            sum += y;
            forwards += normals[3 * v + 2] > 0 ? normals[3 * v + 2] : 0;
        }
        printf("%d %.5f %.5f %.5f %.4f\n", k, low, high, sum / verts, forwards / verts);
    }
    fprintf(stderr, "%u vertices, %.3f ms a frame\n", verts, 1e3 * spent / CLOCKS_PER_SEC / FRAMES);
    /* A body that leaps takes its cloth along at once where motion counts for nothing, and leaves it behind else. */
    float behind[2];
    for (int level = 0; level < 2; level++) {
        muslin_motion_level(garment, (float)level);
        muslin_begin(garment, 1.0f / 30);
        for (int k = 0; k < 4; k++) {
            root[2] = k < 3 ? 0 : 0.3f;
            if (muslin_frame(garment, turns, root, at))
                return 6;
        }
        behind[level] = at[2];
    }
    if (behind[1] == behind[0])
        return 6;
    /* What cannot be is refused, and what was there stays. */
    float was = at[0];
    turns[0] = turns[1] = turns[2] = turns[3] = 0;
    if (!muslin_frame(garment, turns, root, at) || at[0] != was || !muslin_frame(NULL, turns, root, at)
        || !muslin_frame_with_normals(garment, turns, root, at, NULL))
        return 7;
    muslin_close(garment);
    muslin_close(NULL);
    wear.garment = "toga";
    if (muslin_open(NULL, 0, &wear, error, sizeof error) || !strstr(error, "toga"))
        return 8;
    if (muslin_open("no model", 8, NULL, error, 9) || strlen(error) != 8)
        return 9;
    free(turns);
    free(at);
    free(normals);
    return 0;
}
