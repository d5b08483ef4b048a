/* A t-shirt on a rigged character that is turned about: one line a frame with its lowest, highest and mean height in the
 * character's unit.
 *
 *   turntable CHARACTER.glb
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "muslin.h"

enum { FRAMES = 12 };

/* A matrix from a joint to the world, the world turned about the vertical. */
static void turned(const float *from, double angle, float *to)
{
    double c = cos(angle), s = sin(angle);
    for (int k = 0; k < 4; k++) {
        const float *a = from + 4 * k;
        to[4 * k] = (float)(c * a[0] + s * a[2]);
        to[4 * k + 1] = a[1];
        to[4 * k + 2] = (float)(c * a[2] - s * a[0]);
        to[4 * k + 3] = a[3];
    }
}

int main(int count, char **words)
{
    char error[512];
    muslin_wear wear = { 0 };
    wear.garment = "tee";
    wear.body = count > 1 ? words[1] : "no-character.glb";
    muslin_garment *garment = muslin_open(NULL, 0, &wear, error, sizeof error);
    if (!garment) {
        fprintf(stderr, "%s\n", error);
        return 4;
    }
    uint32_t joints = muslin_joints(garment), verts = muslin_vertices(garment);
    float *bound = calloc(joints, 16 * sizeof *bound), *now = calloc(joints, 16 * sizeof *now);
    float *at = calloc(verts, 3 * sizeof *at), *normals = calloc(verts, 3 * sizeof *normals);
    if (!joints || !bound || !now || !at || !normals)
        return 1;
    for (uint32_t j = 0; j < joints; j++) {
        if (!muslin_joint_name(garment, j))
            return 1;
        muslin_joint_bound(garment, j, bound + 16 * j);
    }
    muslin_begin(garment, 1.0f / 30);
    muslin_motion_level(garment, 0);
    for (int k = 0; k < FRAMES; k++) {
        for (uint32_t j = 0; j < joints; j++)
            turned(bound + 16 * j, 6.283185307179586 * k / FRAMES, now + 16 * j);
        if (muslin_frame_on(garment, now, at, k % 2 ? normals : NULL))
            return 6;
        float low = at[1], high = at[1];
        double sum = 0;
        for (uint32_t v = 0; v < verts; v++) {
            float y = at[3 * v + 1];
            low = y < low ? y : low;
            high = y > high ? y : high;
            sum += y;
        }
        printf("%d %.4f %.4f %.5f\n", k, low, high, sum / verts);
    }
    /* What cannot be is refused. */
    now[5] = NAN;
    if (!muslin_frame_on(garment, now, at, NULL) || !muslin_frame_on(garment, bound, NULL, NULL)
        || !muslin_frame_on(NULL, bound, at, NULL) || muslin_joint_name(garment, joints))
        return 7;
    muslin_close(garment);
    free(bound);
    free(now);
    free(at);
    free(normals);
    return 0;
}
