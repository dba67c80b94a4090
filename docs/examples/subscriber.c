/* Listens to a chatter_monitor: a line for each verdict, and one for the newest dynamic parameters.
 *
 *   cc -std=c11 -Wall -Wextra -o subscriber subscriber.c -lzmq -lcjson -lm     (Debian: libzmq3-dev libcjson-dev)
 *   ./subscriber [ENDPOINT [SERVER.key CLIENT.key_secret]]
 *
 * Ends when the monitor does. Exit code 3 if messages were lost, 2 if it was called wrongly.
 */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

enum { PARTS = 16, TOPICS = 64, MODES = 4, KEY = 41 };

static void die(const char *what)
{
    fprintf(stderr, "subscriber: %s: %s\n", what, zmq_strerror(zmq_errno()));
    exit(2);
}

/* Reads a key of a certificate file: the line  name = "forty characters of Z85".  */
static void read_key(const char *path, const char *name, char key[KEY])
{
    char line[256], form[64];
    FILE *file = fopen(path, "r");
    if (!file) die(path);
    snprintf(form, sizeof form, " %s = \"%%40[^\"]\"", name);
    key[0] = 0;
    while (!key[0] && fgets(line, sizeof line, file)) sscanf(line, form, key);
    fclose(file);
    if (strlen(key) != KEY - 1) die(path);
}

/* With the monitor's public certificate and our own secret one the connection is encrypted. */
static void encrypt(void *socket, const char *server_path, const char *own_path)
{
    char server[KEY], public[KEY], secret[KEY];
    read_key(server_path, "public-key", server);
    read_key(own_path, "public-key", public);
    read_key(own_path, "secret-key", secret);
    if (zmq_setsockopt(socket, ZMQ_CURVE_SERVERKEY, server, KEY) || zmq_setsockopt(socket, ZMQ_CURVE_PUBLICKEY, public, KEY)
        || zmq_setsockopt(socket, ZMQ_CURVE_SECRETKEY, secret, KEY))
        die("the keys are not taken");
}

/* Receives one message; returns the number of its frames. */
static int receive(void *socket, zmq_msg_t parts[PARTS])
{
    int n = 0, more = 1;
    while (more) {
        zmq_msg_t surplus, *part = n < PARTS ? &parts[n] : &surplus;
        zmq_msg_init(part);
        if (zmq_msg_recv(part, socket, 0) < 0) die("receiving");
        more = zmq_msg_more(part);
        if (n < PARTS) n++;
        else zmq_msg_close(&surplus);
    }
    return n;
}

static cJSON *json_of(zmq_msg_t *part) { return cJSON_ParseWithLength(zmq_msg_data(part), zmq_msg_size(part)); }

static double number(const cJSON *object, const char *name)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, name);
    return cJSON_IsNumber(item) ? item->valuedouble : NAN; /* null: there is no such number now */
}

/* Messages of a topic that are missing before this one. `session` is new when the monitor was restarted. */
static long missing(const char *topic, const cJSON *header)
{
    static struct { char topic[32]; long next; } seen[TOPICS];
    static char session[64];
    const char *now = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(header, "session"));
    if (now && strcmp(session, now)) {
        memset(seen, 0, sizeof seen);
        snprintf(session, sizeof session, "%s", now);
    }
    for (int i = 0; i < TOPICS; i++) {
        long seq = (long)number(header, "seq"), gap;
        if (!seen[i].topic[0]) { /* the first that we hear of it: what came before was not meant for us */
            snprintf(seen[i].topic, sizeof seen[i].topic, "%s", topic);
            seen[i].next = seq;
        }
        if (strcmp(seen[i].topic, topic)) continue;
        gap = seq - seen[i].next;
        seen[i].next = seq + 1;
        return gap;
    }
    return 0;
}

/* A value of a payload frame by its name: little-endian float32 of shape [samples, modes] in C order. */
static double value(const cJSON *header, zmq_msg_t parts[], int n, const char *name, long row, long mode)
{
    const cJSON *about, *payloads = cJSON_GetObjectItemCaseSensitive(header, "payloads");
    int frame = 2;
    cJSON_ArrayForEach(about, payloads)
    {
        const cJSON *shape = cJSON_GetObjectItemCaseSensitive(about, "shape");
        const char *is = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(about, "name"));
        const char *dtype = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(about, "dtype"));
        if (frame < n && is && dtype && !strcmp(is, name) && !strcmp(dtype, "<f4") && cJSON_GetArraySize(shape) == 2) {
            long rows = (long)cJSON_GetArrayItem(shape, 0)->valuedouble;
            long modes = (long)cJSON_GetArrayItem(shape, 1)->valuedouble;
            size_t at = 4 * (size_t)((row < 0 ? rows + row : row) * modes + mode);
            const unsigned char *bytes = zmq_msg_data(&parts[frame]);
            if (mode >= modes || at + 4 > zmq_msg_size(&parts[frame])) return NAN;
            unsigned bits = bytes[at] | bytes[at + 1] << 8 | bytes[at + 2] << 16 | (unsigned)bytes[at + 3] << 24;
            float result;
            memcpy(&result, &bits, sizeof result);
            return result;
        }
        frame++;
    }
    return NAN;
}

int main(int count, char *arguments[])
{
    void *context = zmq_ctx_new(), *socket = zmq_socket(context, ZMQ_SUB);
    const char *endpoint = count > 1 ? arguments[1] : "tcp://127.0.0.1:5557";
    int finished = 0, no_limit = 0;
    long lost = 0;

    if (count == 4) encrypt(socket, arguments[2], arguments[3]);
    else if (count > 2) {
        fprintf(stderr, "subscriber [ENDPOINT [SERVER.key CLIENT.key_secret]]\n");
        return 2;
    }
    zmq_setsockopt(socket, ZMQ_RCVHWM, &no_limit, sizeof no_limit);
    zmq_setsockopt(socket, ZMQ_SUBSCRIBE, "", 0); /* everything; "verdict." would be the verdicts only */
    if (zmq_connect(socket, endpoint)) die(endpoint);

    while (!finished) {
        zmq_msg_t parts[PARTS];
        int n = receive(socket, parts);
        char topic[32];
        snprintf(topic, sizeof topic, "%.*s", (int)zmq_msg_size(&parts[0]), (char *)zmq_msg_data(&parts[0]));
        cJSON *header = n > 2 ? json_of(&parts[1]) : NULL;
        lost += header ? missing(topic, header) : 0;
        if (header && !strncmp(topic, "odp.", 4)) {
            printf("%s sample %.0f, last row:", topic, number(header, "sample0"));
            for (long mode = 0; mode < MODES; mode++)
                printf(" %.2f Hz %.5f", value(header, parts, n, "frequency_hz", -1, mode),
                       value(header, parts, n, "damping_ratio", -1, mode));
            printf("\n");
        } else if (header) {
            cJSON *body = json_of(&parts[2]);
            const char *state = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(body, "state"));
            if (!strncmp(topic, "verdict.", 8))
                printf("%s %.2f s: %s %.2f Hz\n", topic, number(body, "t0"), state, number(body, "frequency_hz"));
            finished = !strcmp(topic, "health") && state && !strcmp(state, "finished");
            cJSON_Delete(body);
        }
        cJSON_Delete(header);
        while (n > 0) zmq_msg_close(&parts[--n]);
    }
    zmq_close(socket);
    zmq_ctx_term(context);
    fprintf(stderr, "%ld messages lost\n", lost);
    return lost ? 3 : 0;
}
