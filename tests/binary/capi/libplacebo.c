/* A host whose Vulkan objects are libplacebo's: ashfall adopts its device and draws into its texture, which libplacebo
 * reads back and renders to 8 bits.
 *
 *     libplacebo SCENE PIXELS [lie]
 *
 * As examples/host.c. With a third argument libplacebo is told a wrong layout, which validation reports: status 2. */

#include <ashfall.h>
#include <libplacebo/renderer.h>
#include <libplacebo/vulkan.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 320, HEIGHT = 240, VALUES = WIDTH * HEIGHT * 4 };

#define ZERO(value) memset(&(value), 0, sizeof(value))

static void fail(const char *call, const char *message) {
    fprintf(stderr, "%s: %s\n", call, message);
    exit(1);
}

static void vulkan(const char *call, VkResult result) {
    if (result != VK_SUCCESS) fail(call, "failed");
}

static void ashfall(const char *call, AshfallResult result) {
    if (result != ASHFALL_OK) fail(call, ashfall_last_error());
}

static void placebo(const char *call, bool succeeded) {
    if (!succeeded) fail(call, "failed");
}

/* Errors of libplacebo, and of the validation layer through it, end the program. */
static void on_message(void *user, enum pl_log_level level, const char *message) {
    (void)user;
    fprintf(stderr, "libplacebo: %s\n", message);
    if (level <= PL_LOG_ERR) _Exit(2);
}

/* A device of libplacebo. It takes a structure for each feature, not those of whole Vulkan versions. */
static pl_vulkan create_device(pl_log log, pl_vk_inst instance) {
    VkPhysicalDeviceSynchronization2Features synchronization = {
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES, NULL, VK_FALSE};
    VkPhysicalDeviceTimelineSemaphoreFeatures timeline = {
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES, &synchronization, VK_FALSE};
    VkPhysicalDeviceScalarBlockLayoutFeatures scalar = {
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SCALAR_BLOCK_LAYOUT_FEATURES, &timeline, VK_FALSE};
    VkPhysicalDeviceFeatures2 features;
    uint32_t missing = 0;
    pl_vulkan device;
    ashfall("ashfall_enable_features", ashfall_enable_features(&scalar, NULL, &missing));
    if (missing != 0) fail("ashfall_enable_features", "the chain lacks a structure");
    ZERO(features);
    features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    features.pNext = &scalar;
    device = pl_vulkan_create(log, pl_vulkan_params(
        .instance = instance->instance,
        .get_proc_addr = instance->get_proc_addr,
        .allow_software = true,
        .features = &features));
    placebo("pl_vulkan_create", device != NULL);
    return device;
}

/* The queue that libplacebo computes on; used by others between its lock and unlock. */
static VkQueue queue_of(pl_vulkan device) {
    VkQueue queue;
    vkGetDeviceQueue(device->device, device->queue_compute.index, 0, &queue);
    return queue;
}

/* The device, with the features that libplacebo did enable. */
static AshfallDevice *adopt(pl_vk_inst instance, pl_vulkan device) {
    AshfallDevice *adopted = NULL;
    AshfallDeviceInfo lent;
    ZERO(lent);
    lent.size = sizeof(lent);
    lent.header_version = ASHFALL_HEADER_VERSION;
    lent.api_version = device->api_version < instance->api_version ? device->api_version : instance->api_version;
    lent.queue_family = device->queue_compute.index;
    lent.get_instance_proc_addr = instance->get_proc_addr;
    lent.instance = device->instance;
    lent.physical_device = device->phys_device;
    lent.device = device->device;
    lent.created_with = device->features;
    lent.queue = queue_of(device);
    lent.flags = ASHFALL_DEBUG_UTILS;
    ashfall("ashfall_adopt", ashfall_adopt(&lent, &adopted));
    return adopted;
}

/* A texture of floats for ashfall to draw to, or of bytes for libplacebo. */
static pl_tex create_texture(pl_gpu gpu, bool floats) {
    const enum pl_fmt_caps caps = floats ? PL_FMT_CAP_STORABLE | PL_FMT_CAP_SAMPLEABLE : PL_FMT_CAP_RENDERABLE;
    const int depth = floats ? 32 : 8;
    pl_tex texture = pl_tex_create(gpu, pl_tex_params(
        .w = WIDTH,
        .h = HEIGHT,
        .format = pl_find_fmt(gpu, floats ? PL_FMT_FLOAT : PL_FMT_UNORM, 4, depth, depth, caps),
        .storable = floats,
        .sampleable = floats,
        .renderable = !floats,
        .host_readable = true));
    placebo("pl_tex_create", texture != NULL);
    return texture;
}

/* Records a picture of the model into the image, in VK_IMAGE_LAYOUT_GENERAL before and after. */
static void record(AshfallRenderer *renderer, AshfallModel *model, VkCommandBuffer commands, VkImage image,
        VkImageView view) {
    const VkCommandBufferBeginInfo begin = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, NULL, 0, NULL};
    AshfallInstance instance;
    AshfallCamera camera;
    AshfallImage color;
    AshfallDraw picture;
    ZERO(instance), ZERO(camera), ZERO(color), ZERO(picture);
    instance.size = sizeof(instance);
    instance.model = model;
    camera.size = sizeof(camera);
    camera.width = WIDTH;
    camera.height = HEIGHT;
    camera.focal[0] = camera.focal[1] = HEIGHT;
    camera.center[0] = WIDTH / 2.0;
    camera.center[1] = HEIGHT / 2.0;
    camera.rotation[0] = camera.rotation[4] = camera.rotation[8] = 1.0;
    camera.position[2] = -4.0;
    color.size = sizeof(color);
    color.format = VK_FORMAT_R32G32B32A32_SFLOAT;
    color.image = image;
    color.view = view;
    color.width = WIDTH;
    color.height = HEIGHT;
    color.before.layout = color.after.layout = VK_IMAGE_LAYOUT_GENERAL;
    color.before.stage = color.after.stage = VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT;
    picture.size = sizeof(picture);
    picture.instance_count = 1;
    picture.instances = &instance;
    picture.camera = &camera;
    picture.color = &color;
    picture.background[0] = 0.25f;
    picture.background[1] = 0.5f;
    picture.background[2] = 0.75f;
    picture.near_plane = 0.0625f;
    ashfall("ashfall_renderer_reserve", ashfall_renderer_reserve(renderer, &picture, 0));
    vulkan("vkBeginCommandBuffer", vkBeginCommandBuffer(commands, &begin));
    ashfall("ashfall_cmd_draw", ashfall_cmd_draw(renderer, commands, 0, &picture, NULL));
    vulkan("vkEndCommandBuffer", vkEndCommandBuffer(commands));
}

/* Submits commands that run between two values of the semaphore. */
static void submit(pl_vulkan device, VkCommandBuffer commands, VkSemaphore semaphore, uint64_t from, uint64_t to) {
    const VkPipelineStageFlags stage = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT;
    const VkTimelineSemaphoreSubmitInfo values = {
        VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO, NULL, 1, &from, 1, &to};
    const VkSubmitInfo submitted = {
        VK_STRUCTURE_TYPE_SUBMIT_INFO, &values, 1, &semaphore, &stage, 1, &commands, 1, &semaphore};
    device->lock_queue(device, device->queue_compute.index, 0);
    vulkan("vkQueueSubmit", vkQueueSubmit(queue_of(device), 1, &submitted, VK_NULL_HANDLE));
    device->unlock_queue(device, device->queue_compute.index, 0);
}

/* Holds the texture, draws into its image and releases it to libplacebo, which waits for the picture and reads it. */
static void draw(pl_vulkan device, pl_tex texture, AshfallRenderer *renderer, AshfallModel *model, bool lies,
        float *pixels) {
    const VkSemaphoreTypeCreateInfo timeline = {
        VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO, NULL, VK_SEMAPHORE_TYPE_TIMELINE, 0};
    const VkSemaphoreCreateInfo semaphore_info = {VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO, &timeline, 0};
    const VkCommandPoolCreateInfo pool_info = {
        VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, NULL, 0, device->queue_compute.index};
    VkCommandBufferAllocateInfo commands_info = {
        VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, NULL, VK_NULL_HANDLE, VK_COMMAND_BUFFER_LEVEL_PRIMARY, 1};
    VkImageViewCreateInfo view_info;
    VkFormat format = VK_FORMAT_UNDEFINED;
    VkImage image = pl_vulkan_unwrap(device->gpu, texture, &format, NULL);
    VkImageView view;
    VkSemaphore semaphore;
    VkCommandPool pool;
    VkCommandBuffer commands;
    ZERO(view_info);
    view_info.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO;
    view_info.image = image;
    view_info.viewType = VK_IMAGE_VIEW_TYPE_2D;
    view_info.format = format;
    view_info.subresourceRange.aspectMask = VK_IMAGE_ASPECT_COLOR_BIT;
    view_info.subresourceRange.levelCount = view_info.subresourceRange.layerCount = 1;
    vulkan("vkCreateImageView", vkCreateImageView(device->device, &view_info, NULL, &view));
    vulkan("vkCreateSemaphore", vkCreateSemaphore(device->device, &semaphore_info, NULL, &semaphore));
    vulkan("vkCreateCommandPool", vkCreateCommandPool(device->device, &pool_info, NULL, &pool));
    commands_info.commandPool = pool;
    vulkan("vkAllocateCommandBuffers", vkAllocateCommandBuffers(device->device, &commands_info, &commands));

    placebo("pl_vulkan_hold", pl_vulkan_hold(
        device->gpu, texture, VK_IMAGE_LAYOUT_GENERAL, (pl_vulkan_sem){.sem = semaphore, .value = 1}));
    record(renderer, model, commands, image, view);
    submit(device, commands, semaphore, 1, 2);
    pl_vulkan_release(device->gpu, texture, lies ? VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL : VK_IMAGE_LAYOUT_GENERAL,
        (pl_vulkan_sem){.sem = semaphore, .value = 2});

    /* libplacebo's commands wait for the semaphore. Mesa reads it until the queue is idle. */
    placebo("pl_tex_download", pl_tex_download(device->gpu, pl_tex_transfer_params(.tex = texture, .ptr = pixels)));
    pl_gpu_finish(device->gpu);
    device->lock_queue(device, device->queue_compute.index, 0);
    vulkan("vkQueueWaitIdle", vkQueueWaitIdle(queue_of(device)));
    device->unlock_queue(device, device->queue_compute.index, 0);
    vkDestroyCommandPool(device->device, pool, NULL);
    vkDestroySemaphore(device->device, semaphore, NULL);
    vkDestroyImageView(device->device, view, NULL);
}

/* Renders the picture to 8 bits without a change of colour: its values rounded. */
static void render(pl_log log, pl_gpu gpu, pl_tex texture, const float *pixels) {
    static unsigned char levels[VALUES];
    pl_renderer renderer = pl_renderer_create(log, gpu);
    pl_tex shown = create_texture(gpu, false);
    struct pl_frame image, target;
    int i;
    ZERO(image), ZERO(target);
    image.num_planes = 1;
    image.planes[0].texture = texture;
    image.planes[0].components = 3;
    for (i = 0; i < 4; i++) image.planes[0].component_mapping[i] = i;
    image.repr = pl_color_repr_rgb;
    image.color = pl_color_space_srgb;
    target = image;
    target.planes[0].texture = shown;
    placebo("pl_render_image", pl_render_image(renderer, &image, &target, &pl_render_fast_params));
    placebo("pl_tex_download", pl_tex_download(gpu, pl_tex_transfer_params(.tex = shown, .ptr = levels)));
    for (i = 0; i < VALUES; i++) {
        const float off = levels[i] - 255.0f * (pixels[i] < 0 ? 0 : pixels[i] > 1 ? 1 : pixels[i]);
        if (i % 4 != 3 && (off < -0.51f || off > 0.51f)) fail("pl_render_image", "the levels are of another picture");
    }
    pl_tex_destroy(gpu, &shown);
    pl_renderer_destroy(&renderer);
}

int main(int count, char **arguments) {
    static float pixels[VALUES];
    pl_log log = pl_log_create(
        PL_API_VER, &(struct pl_log_params){.log_cb = on_message, .log_level = PL_LOG_WARN});
    pl_vk_inst instance = pl_vk_inst_create(log, pl_vk_inst_params(.debug = true));
    pl_vulkan device;
    pl_tex texture;
    AshfallDevice *adopted;
    AshfallScene *scene = NULL;
    AshfallModel *model = NULL;
    AshfallRenderer *renderer = NULL;
    FILE *file;
    if (count < 3) fail("libplacebo", "the arguments are SCENE and PIXELS");
    placebo("pl_vk_inst_create", instance != NULL);
    device = create_device(log, instance);
    adopted = adopt(instance, device);
    texture = create_texture(device->gpu, true);
    ashfall("ashfall_scene_read", ashfall_scene_read(arguments[1], &scene));
    device->lock_queue(device, device->queue_compute.index, 0);
    ashfall("ashfall_model_upload", ashfall_model_upload(adopted, scene, ASHFALL_PRECISION_FULL, &model));
    device->unlock_queue(device, device->queue_compute.index, 0);
    ashfall("ashfall_scene_destroy", ashfall_scene_destroy(scene));
    ashfall("ashfall_renderer_create", ashfall_renderer_create(adopted, NULL, &renderer));
    draw(device, texture, renderer, model, count > 3, pixels);
    render(log, device->gpu, texture, pixels);
    file = fopen(arguments[2], "wb");
    if (file == NULL || fwrite(pixels, sizeof(float), VALUES, file) != VALUES || fclose(file) != 0)
        fail(arguments[2], "not written");
    ashfall("ashfall_renderer_destroy", ashfall_renderer_destroy(renderer));
    ashfall("ashfall_model_destroy", ashfall_model_destroy(model));
    ashfall("ashfall_device_destroy", ashfall_device_destroy(adopted));
    pl_tex_destroy(device->gpu, &texture);
    pl_vulkan_destroy(&device);
    pl_vk_inst_destroy(&instance);
    pl_log_destroy(&log);
    return 0;
}
