/* Faulty calls of the C interface: each is refused with its name, and the host goes on. */

#define main host_main
#include "../../../examples/host.c"
#undef main

#include <math.h>

static int faults;

static void refused(int line, AshfallResult found, AshfallResult wanted, const char *part) {
    if (found != wanted || strstr(ashfall_last_error(), part) == NULL) {
        fprintf(stderr, "line %d: result %d with \"%s\", not %d with \"%s\"\n", line, (int)found,
            ashfall_last_error(), (int)wanted, part);
        faults++;
    }
}
#define REFUSED(call, wanted, part) refused(__LINE__, call, wanted, part)

/* Devices that are not adopted. */
static void adoptions(const Host *host) {
    AshfallDeviceInfo info;
    AshfallDevice *device = NULL;
    AshfallMissing missing[3];
    uint32_t count = 3;
    ZERO(info);
    REFUSED(ashfall_adopt(NULL, &device), ASHFALL_ERROR_ARGUMENT, "AshfallDeviceInfo: a null pointer");
    REFUSED(ashfall_adopt(&info, &device), ASHFALL_ERROR_ARGUMENT, "its size is 0");
    info.size = sizeof(info);
    REFUSED(ashfall_adopt(&info, &device), ASHFALL_ERROR_ARGUMENT, "header_version");
    info.header_version = ASHFALL_HEADER_VERSION;
    REFUSED(ashfall_adopt(&info, &device), ASHFALL_ERROR_ARGUMENT, "get_instance_proc_addr");
    info.get_instance_proc_addr = vkGetInstanceProcAddr;
    info.instance = host->instance;
    info.physical_device = host->physical_device;
    REFUSED(ashfall_adopt(&info, &device), ASHFALL_ERROR_ARGUMENT, "device: a null handle");
    info.device = host->device;
    info.api_version = VK_API_VERSION_1_2;
    REFUSED(ashfall_adopt(&info, &device), ASHFALL_ERROR_UNSUPPORTED, "Vulkan 1.3 (1.2 offered)");
    info.api_version = VK_API_VERSION_1_3;
    REFUSED(ashfall_adopt(&info, &device), ASHFALL_ERROR_UNSUPPORTED, "scalarBlockLayout");
    REFUSED(ashfall_adopt(&info, &device), ASHFALL_ERROR_UNSUPPORTED, "synchronization2");
    info.flags = 64;
    REFUSED(ashfall_adopt(&info, &device), ASHFALL_ERROR_ARGUMENT, "flags");
    REFUSED(ashfall_adopt(&info, NULL), ASHFALL_ERROR_ARGUMENT, "device: a null pointer");
    ashfall("ashfall_enable_features", ashfall_enable_features(NULL, missing, &count));
    if (count != 3 || missing[2].structure != VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES
            || strcmp(missing[2].feature, "synchronization2") != 0) {
        fprintf(stderr, "%u structures\n", count);
        faults++;
    }
}

/* Scenes that are not read. Returns one splat. */
static AshfallScene *scenes(void) {
    float mean[3] = {0}, quaternion[4] = {1}, log_scale[3] = {-1, -1, -1}, logit[1] = {4}, sh[3] = {1};
    AshfallArrays arrays;
    AshfallScene *scene = NULL;
    AshfallSceneInfo info;
    ZERO(arrays), ZERO(info);
    REFUSED(ashfall_scene_read("absent.ply", &scene), ASHFALL_ERROR_FILE, "absent.ply");
    REFUSED(ashfall_scene_read(NULL, &scene), ASHFALL_ERROR_ARGUMENT, "path: a null pointer");
    arrays.size = sizeof(arrays);
    arrays.count = 1;
    REFUSED(ashfall_scene_from_arrays(&arrays, &scene), ASHFALL_ERROR_ARGUMENT, "mean: a null pointer");
    arrays.mean = mean;
    arrays.quaternion = quaternion;
    arrays.log_scale = log_scale;
    arrays.opacity_logit = logit;
    arrays.sh = sh;
    arrays.sh_degree = 4;
    REFUSED(ashfall_scene_from_arrays(&arrays, &scene), ASHFALL_ERROR_ARGUMENT, "sh_degree: 4");
    arrays.sh_degree = 0;
    arrays.filter = 9;
    REFUSED(ashfall_scene_from_arrays(&arrays, &scene), ASHFALL_ERROR_ARGUMENT, "filter: 9");
    arrays.filter = ASHFALL_FILTER_MIP;
    ashfall("ashfall_scene_from_arrays", ashfall_scene_from_arrays(&arrays, &scene));
    REFUSED(ashfall_scene_info(scene, &info), ASHFALL_ERROR_ARGUMENT, "AshfallSceneInfo: its size is 0");
    info.size = sizeof(info);
    ashfall("ashfall_scene_info", ashfall_scene_info(scene, &info));
    if (info.size != sizeof(info) || info.count != 1 || info.filter != ASHFALL_FILTER_MIP) {
        fprintf(stderr, "the scene has %u splats of filter %u\n", info.count, info.filter);
        faults++;
    }
    return scene;
}

typedef struct Picture {
    AshfallInstance instance;
    AshfallCamera camera;
    AshfallImage color;
    AshfallDraw draw;
} Picture;

static void prepare(Picture *picture, const Host *host, AshfallModel *model) {
    memset(picture, 0, sizeof(*picture));
    picture->instance.size = sizeof(picture->instance);
    picture->instance.model = model;
    picture->camera.size = sizeof(picture->camera);
    picture->camera.width = WIDTH;
    picture->camera.height = HEIGHT;
    picture->camera.focal[0] = picture->camera.focal[1] = HEIGHT;
    picture->camera.center[0] = WIDTH / 2.0;
    picture->camera.center[1] = HEIGHT / 2.0;
    picture->camera.position[2] = -4;
    picture->camera.rotation[0] = picture->camera.rotation[4] = picture->camera.rotation[8] = 1;
    picture->color.size = sizeof(picture->color);
    picture->color.format = VK_FORMAT_R32G32B32A32_SFLOAT;
    picture->color.image = host->image;
    picture->color.view = host->view;
    picture->color.width = WIDTH;
    picture->color.height = HEIGHT;
    picture->color.after.layout = VK_IMAGE_LAYOUT_GENERAL;
    picture->color.after.stage = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT;
    picture->color.after.access = VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_MEMORY_WRITE_BIT;
    picture->draw.size = sizeof(picture->draw);
    picture->draw.instance_count = 1;
    picture->draw.instances = &picture->instance;
    picture->draw.camera = &picture->camera;
    picture->draw.color = &picture->color;
}

/* Takes a report of the right half of the middle row, if there is to be one. */
static void picks(AshfallRenderer *renderer, uint32_t available) {
    AshfallPickPixel pixels[WIDTH / 2];
    AshfallPickReport report;
    const AshfallPickPixel *last = &pixels[WIDTH / 2 - 1];
    ZERO(pixels), ZERO(report);
    REFUSED(ashfall_take_pick(renderer, &report, pixels, 1), ASHFALL_ERROR_ARGUMENT, "its size is 0");
    report.size = sizeof(report);
    REFUSED(ashfall_take_pick(renderer, &report, NULL, 0), ASHFALL_ERROR_ARGUMENT, "pixels: a null pointer");
    if (available) {
        REFUSED(ashfall_take_pick(renderer, &report, pixels, 1), ASHFALL_ERROR_ARGUMENT, "the report has 160");
    }
    ashfall("ashfall_take_pick", ashfall_take_pick(renderer, &report, pixels, WIDTH / 2));
    if (report.available != available) {
        fprintf(stderr, "%u reports, not %u\n", report.available, available);
        faults++;
    }
    if (!available) return;
    if (report.x != WIDTH / 2 || report.y != HEIGHT / 2 || report.width != WIDTH / 2 || report.height != 1
            || pixels[0].instance != 0 || pixels[0].splat != 0 || pixels[0].depth != 4
            || !(pixels[0].transmittance < 0.5f) || last->instance != ASHFALL_NO_SPLAT
            || last->splat != ASHFALL_NO_SPLAT || !isinf(last->depth) || last->transmittance != 1) {
        fprintf(stderr, "picked: splat %u at %g, splat %u at %g\n", pixels[0].splat, pixels[0].depth, last->splat,
            last->depth);
        faults++;
    }
}

/* Pictures that are not drawn, in one frame that is submitted with one that is. */
static void pictures(const Host *host, AshfallDevice *device, AshfallScene *scene) {
    AshfallRenderer *renderer = NULL;
    AshfallModel *model = NULL;
    AshfallRendererInfo options;
    AshfallReport report;
    AshfallPickArea area;
    VkCommandBufferBeginInfo begin;
    VkSubmitInfo submit;
    VkCommandBuffer commands = host->commands;
    const double mirror[12] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    Picture p;
    ZERO(options), ZERO(report), ZERO(area), ZERO(begin), ZERO(submit);
    options.size = sizeof(options);
    options.frames_in_flight = 1000;
    REFUSED(ashfall_renderer_create(device, &options, &renderer), ASHFALL_ERROR_ARGUMENT, "frames_in_flight: 1000");
    options.frames_in_flight = 1;
    options.precision = 3;
    REFUSED(ashfall_renderer_create(device, &options, &renderer), ASHFALL_ERROR_ARGUMENT, "precision: 3");
    options.precision = ASHFALL_PRECISION_HALF;
    options.flags = 64;
    REFUSED(ashfall_renderer_create(device, &options, &renderer), ASHFALL_ERROR_ARGUMENT, "flags: 0x40");
    options.flags = ASHFALL_IDS;
    ashfall("ashfall_renderer_create", ashfall_renderer_create(device, &options, &renderer));
    REFUSED(ashfall_model_upload(device, scene, 0, &model), ASHFALL_ERROR_UNSUPPORTED, "without a queue");
    begin.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
    vulkan("vkBeginCommandBuffer", vkBeginCommandBuffer(commands, &begin));
    REFUSED(ashfall_cmd_upload(renderer, NULL, 7, scene, &model), ASHFALL_ERROR_ARGUMENT, "commands: a null handle");
    ashfall("ashfall_cmd_upload", ashfall_cmd_upload(renderer, commands, 7, scene, &model));

    prepare(&p, host, model);
    p.color.after.layout = VK_IMAGE_LAYOUT_UNDEFINED;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_ARGUMENT, "layout after");
    prepare(&p, host, model);
    p.color.view = VK_NULL_HANDLE;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_ARGUMENT, "color: a null image");
    prepare(&p, host, model);
    p.camera.position[1] = NAN;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_ARGUMENT, "camera: not finite");
    prepare(&p, host, (AshfallModel *)scene);
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_ARGUMENT, "the handle of a scene");
    prepare(&p, host, model);
    p.instance.world_from_model = mirror;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_ARGUMENT, "instance 0: a transform");
    prepare(&p, host, model);
    p.draw.blend = 17;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_ARGUMENT, "blend: 17");
    prepare(&p, host, model);
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, &report), ASHFALL_ERROR_ARGUMENT, "AshfallReport");
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_CONFIG, "reserve");
    ashfall("ashfall_renderer_reserve", ashfall_renderer_reserve(renderer, &p.draw, 0));
    /* The refusal has left the image in its state after. */
    p.color.before = p.color.after;
    p.camera.width = WIDTH / 2;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_CONFIG, "160x240");
    p.camera.width = WIDTH;
    p.draw.blend = ASHFALL_BLEND_OVER_DISPLAY;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_CONFIG, "with_host_color");
    p.draw.blend = ASHFALL_BLEND_REPLACE;
    p.color.format = VK_FORMAT_R8G8B8A8_SRGB;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_UNSUPPORTED, "R8G8B8A8_SRGB");
    p.color.format = VK_FORMAT_R32G32B32A32_SFLOAT;
    /* The right half of the middle row. */
    area.size = sizeof(area);
    area.x = area.width = WIDTH / 2;
    area.y = HEIGHT / 2;
    p.draw.pick = &area;
    REFUSED(ashfall_cmd_draw(renderer, commands, 7, &p.draw, NULL), ASHFALL_ERROR_CONFIG, "65536 pixels");
    area.height = 1;
    report.size = sizeof(report);
    ashfall("ashfall_cmd_draw", ashfall_cmd_draw(renderer, commands, 7, &p.draw, &report));
    picks(renderer, 0);
    if (report.available != 0 || strcmp(ashfall_last_error(), "") != 0) faults++;
    vulkan("vkEndCommandBuffer", vkEndCommandBuffer(commands));
    submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
    submit.commandBufferCount = 1;
    submit.pCommandBuffers = &commands;
    vulkan("vkQueueSubmit", vkQueueSubmit(host->queue, 1, &submit, VK_NULL_HANDLE));
    vulkan("vkQueueWaitIdle", vkQueueWaitIdle(host->queue));

    /* The frame that comes next reports this one. */
    vulkan("vkResetCommandPool", vkResetCommandPool(host->device, host->pool, 0));
    vulkan("vkBeginCommandBuffer", vkBeginCommandBuffer(commands, &begin));
    ashfall("ashfall_cmd_draw", ashfall_cmd_draw(renderer, commands, 8, &p.draw, &report));
    if (report.available != 1 || report.complete != 1 || report.passes != 1) {
        fprintf(stderr, "report: %u, complete %u, %u passes\n", report.available, report.complete, report.passes);
        faults++;
    }
    picks(renderer, 1);
    picks(renderer, 0);
    ashfall("ashfall_model_destroy", ashfall_model_destroy(model));
    REFUSED(ashfall_cmd_draw(renderer, commands, 8, &p.draw, NULL), ASHFALL_ERROR_ARGUMENT, "model: a destroyed");
    REFUSED(ashfall_model_destroy(model), ASHFALL_ERROR_ARGUMENT, "a destroyed handle");
    vulkan("vkEndCommandBuffer", vkEndCommandBuffer(commands));
    ashfall("ashfall_renderer_destroy", ashfall_renderer_destroy(renderer));
    ashfall("ashfall_renderer_destroy", ashfall_renderer_destroy(NULL));
}

int main(void) {
    Host host;
    AshfallDevice *device;
    AshfallScene *scene;
    ZERO(host);
    create_instance(&host);
    device = create_device(&host, VK_FALSE);
    create_image(&host);
    create_commands(&host);
    adoptions(&host);
    scene = scenes();
    pictures(&host, device, scene);
    ashfall("ashfall_scene_destroy", ashfall_scene_destroy(scene));
    ashfall("ashfall_device_destroy", ashfall_device_destroy(device));
    destroy(&host);
    return faults == 0 && messages == 0 ? 0 : 1;
}
