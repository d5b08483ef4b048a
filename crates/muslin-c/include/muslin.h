/* Muslin: a trained garment, frame by frame.
 *
 * A garment is opened once, on a body of ours of some height, weight and gender, or on a rigged character of yours;
 * then every call of muslin_frame, or of muslin_frame_on for a character, gives the cloth in one more pose, as its
 * network predicts it, in a fraction of a millisecond. It takes no memory, reads no file and is not checked: cloth may
 * touch where training did not reach.
 *
 * Metres, seconds, right-handed, Y up, the body faces +Z; a character is in the places and the unit of its file.
 * Quaternions are x, y, z, w; matrices are of 16 numbers, column after column, as glTF has them. A garment may be used by
 * one thread at a time; two garments by two. Nothing here ends the program, and nothing is
 * printed but where a fault of ours is caught.
 *
 *   cargo build --release -p muslin-c
 *   cc program.c -Icrates/muslin-c/include target/release/libmuslin_c.a -lm -lpthread -ldl
 */
#ifndef MUSLIN_H
#define MUSLIN_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct muslin_garment muslin_garment;

/* Who wears what. Zero it, then set what matters: what is zero is as the model was taught. */
typedef struct muslin_wear {
    const char *garment; /* of the wardrobe, as `muslin list garments` names it, where no model is given; or the file of the
                          * garment that the model is of */
    const char *fabric;  /* as `muslin list fabrics` names it, or a file of yours */
    const char *size;    /* "XS" to "XXL"; made to measure where the model was */
    double height;       /* [m] */
    double weight;       /* [kg] */
    double gender;       /* above 0 (male) to 1 (female) */
    const char *body;    /* a character's file: .glb, .gltf or .vrm; it has a weight and a gender of its own */
} muslin_wear;

/* What is returned where nothing is: a root's parent. */
#define MUSLIN_NONE UINT32_MAX

/* Opens the model in `n_bytes` bytes of a .muslin file, or, where `model` is NULL, that of the garment named in
 * `wear`. `wear` may be NULL with a model. Takes about two seconds. NULL if it cannot be done: then `error`, if
 * not NULL, holds why, cut to `error_room` bytes with its closing zero. */
muslin_garment *muslin_open(const void *model, size_t n_bytes, const muslin_wear *wear,
                            char *error, size_t error_room);

/* Gives its memory back; NULL is no fault. */
void muslin_close(muslin_garment *garment);

/* How many vertices and triangles the cloth has. */
uint32_t muslin_vertices(const muslin_garment *garment);
uint32_t muslin_triangles(const muslin_garment *garment);

/* Three corners a triangle, counter-clockwise seen from outside; until the garment is closed. */
const uint32_t *muslin_corners(const muslin_garment *garment);

/* The skeleton: how many bones, and of each its name (until the garment is closed; NULL beyond the last), its
 * parent, which comes before it, and where it turns in the rest pose [m]. */
uint32_t muslin_bones(const muslin_garment *garment);
const char *muslin_bone_name(const muslin_garment *garment, uint32_t bone);
uint32_t muslin_bone_parent(const muslin_garment *garment, uint32_t bone);
void muslin_bone_joint(const muslin_garment *garment, uint32_t bone, float joint[3]);

/* The joints of the character: how many (none on our own body), and of each its name, as above, and where it is as the
 * character was bound: the matrix from the joint to the world of its file. */
uint32_t muslin_joints(const muslin_garment *garment);
const char *muslin_joint_name(const muslin_garment *garment, uint32_t joint);
void muslin_joint_bound(const muslin_garment *garment, uint32_t joint, float matrix[16]);

/* Starts a sequence: frames are `seconds` apart from now on (1e-4 to 10; else as before, a thirtieth at first), and the
 * body comes to the first without motion. */
void muslin_begin(muslin_garment *garment, float seconds);

/* How much motion counts: 1 as in nature, 0 as if the body stood still in every pose, 10 at most. Nothing for models of
 * `muslin train pbns|snug`, which do not tell motion from the pose. */
void muslin_motion_level(muslin_garment *garment, float level);

/* The cloth in the next pose. `turns`: four numbers a bone, its turn from rest in its parent's frame. `root`: how far
 * the body is moved [m]. On a character both are of our body in its likeness, and so is the cloth. `vertices`: room for
 * three numbers a vertex [m]. 0 if all is well; 1 where a number is not finite or a turn is nothing: then `vertices` is
 * left as it was, and the sequence begins anew. */
int muslin_frame(muslin_garment *garment, const float *turns, const float root[3], float *vertices);

/* The same, and the unit normal of every vertex: `normals` is room for three numbers a vertex. */
int muslin_frame_with_normals(muslin_garment *garment, const float *turns, const float root[3], float *vertices,
                              float *normals);

/* The cloth where the character's joints are next. `joints`: a matrix a joint, from the joint to the world of the
 * character's file, of which turns and places are taken; of joints that lead none of our bones (fingers, sockets)
 * nothing is. The vertices are in that world as well; `normals` may be NULL. Else as muslin_frame; 1 on our own body. */
int muslin_frame_on(muslin_garment *garment, const float *joints, float *vertices, float *normals);

#ifdef __cplusplus
}
#endif

#endif
