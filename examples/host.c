/* Embedding in C: a host that lends its Vulkan device, and has a scene drawn into its image by its command buffer.
 *
 *     host SCENE PIXELS
 *
 * SCENE is a file of splats. PIXELS receives 320 x 240 pixels from the top left, four 32-bit floats each. C99, C++. */

#include <ashfall.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vulkan.h>

enum { WIDTH = 320, HEIGHT = 240, BYTES = WIDTH * HEIGHT * 16 };

#define ZERO(value) memset(&(value), 0, sizeof(value))

/* Vulkan objects of the host. */
typedef struct Host {
    VkInstance instance;
    VkDebugUtilsMessengerEXT messenger;
    VkPhysicalDevice physical_device;
    VkDevice device;
    VkQueue queue;
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkImage image;
    VkImageView view;
    VkBuffer pixels;
    VkDeviceMemory image_memory, pixel_memory;
} Host;

static int messages;

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

static VKAPI_ATTR VkBool32 VKAPI_CALL on_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
        VkDebugUtilsMessageTypeFlagsEXT kind, const VkDebugUtilsMessengerCallbackDataEXT *data, void *user) {
    (void)severity, (void)kind, (void)user;
    fprintf(stderr, "validation: %s\n", data->pMessage);
    messages++;
    return VK_FALSE;
}

/* An instance with validation, of the memory model's hazards as well. */
static void create_instance(Host *host) {
    const char *layers[] = {"VK_LAYER_KHRONOS_validation"};
    const char *extensions[] = {VK_EXT_DEBUG_UTILS_EXTENSION_NAME, VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME};
    VkValidationFeatureEnableEXT enabled[] = {VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT};
    VkApplicationInfo application;
    VkDebugUtilsMessengerCreateInfoEXT messenger;
    VkValidationFeaturesEXT validation;
    VkInstanceCreateInfo info;
    PFN_vkCreateDebugUtilsMessengerEXT create;
    ZERO(application), ZERO(messenger), ZERO(validation), ZERO(info);
    application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
    application.apiVersion = VK_API_VERSION_1_3;
    messenger.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
    messenger.messageSeverity =
        VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
    messenger.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT;
    messenger.pfnUserCallback = on_message;
    validation.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT;
    validation.pNext = &messenger;
    validation.enabledValidationFeatureCount = 1;
    validation.pEnabledValidationFeatures = enabled;
    info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
    info.pNext = &validation;
    info.pApplicationInfo = &application;
    info.enabledLayerCount = 1;
    info.ppEnabledLayerNames = layers;
    info.enabledExtensionCount = 2;
    info.ppEnabledExtensionNames = extensions;
    vulkan("vkCreateInstance", vkCreateInstance(&info, NULL, &host->instance));
    create = (PFN_vkCreateDebugUtilsMessengerEXT)vkGetInstanceProcAddr(
        host->instance, "vkCreateDebugUtilsMessengerEXT");
    vulkan("vkCreateDebugUtilsMessengerEXT", create(host->instance, &messenger, NULL, &host->messenger));
}

/* A device with the features that ashfall needs, adopted by it; its queue is for blocking uploads. */
static AshfallDevice *create_device(Host *host, VkBool32 lends_queue) {
    uint32_t one = 1, missing = 0;
    float priority = 1.0f;
    VkPhysicalDeviceVulkan12Features v12;
    VkPhysicalDeviceVulkan13Features v13;
    VkDeviceQueueCreateInfo queue;
    VkDeviceCreateInfo info;
    AshfallDeviceInfo lent;
    AshfallDevice *adopted = NULL;
    ZERO(v12), ZERO(v13), ZERO(queue), ZERO(info), ZERO(lent);
    vkEnumeratePhysicalDevices(host->instance, &one, &host->physical_device);
    v12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
    v12.pNext = &v13;
    v13.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES;
    ashfall("ashfall_enable_features", ashfall_enable_features(&v12, NULL, &missing));
    if (missing != 0) fail("ashfall_enable_features", "the chain lacks a structure");
    queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
    queue.queueCount = 1;
    queue.pQueuePriorities = &priority;
    info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
    info.pNext = &v12;
    info.queueCreateInfoCount = 1;
    info.pQueueCreateInfos = &queue;
    vulkan("vkCreateDevice", vkCreateDevice(host->physical_device, &info, NULL, &host->device));
    vkGetDeviceQueue(host->device, 0, 0, &host->queue);

    lent.size = sizeof(lent);
    lent.header_version = ASHFALL_HEADER_VERSION;
    lent.api_version = VK_API_VERSION_1_3;
    lent.get_instance_proc_addr = vkGetInstanceProcAddr;
    lent.instance = host->instance;
    lent.physical_device = host->physical_device;
    lent.device = host->device;
    lent.created_with = &v12;
    lent.queue = lends_queue ? host->queue : NULL;
    lent.flags = ASHFALL_DEBUG_UTILS;
    ashfall("ashfall_adopt", ashfall_adopt(&lent, &adopted));
    return adopted;
}

static VkDeviceMemory allocate(const Host *host, VkMemoryRequirements needs, VkMemoryPropertyFlags wanted) {
    VkPhysicalDeviceMemoryProperties types;
    VkMemoryAllocateInfo info;
    VkDeviceMemory memory = VK_NULL_HANDLE;
    uint32_t type = 0;
    vkGetPhysicalDeviceMemoryProperties(host->physical_device, &types);
    while (type < types.memoryTypeCount && !((needs.memoryTypeBits >> type & 1)
            && (types.memoryTypes[type].propertyFlags & wanted) == wanted)) type++;
    ZERO(info);
    info.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
    info.allocationSize = needs.size;
    info.memoryTypeIndex = type;
    vulkan("vkAllocateMemory", vkAllocateMemory(host->device, &info, NULL, &memory));
    return memory;
}

/* The image to draw to, and a buffer for its pixels. */
static void create_image(Host *host) {
    VkImageCreateInfo image;
    VkImageViewCreateInfo view;
    VkBufferCreateInfo buffer;
    VkMemoryRequirements needs;
    ZERO(image), ZERO(view), ZERO(buffer);
    image.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO;
    image.imageType = VK_IMAGE_TYPE_2D;
    image.format = VK_FORMAT_R32G32B32A32_SFLOAT;
    image.extent.width = WIDTH;
    image.extent.height = HEIGHT;
    image.extent.depth = image.mipLevels = image.arrayLayers = 1;
    image.samples = VK_SAMPLE_COUNT_1_BIT;
    image.usage = VK_IMAGE_USAGE_STORAGE_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT;
    vulkan("vkCreateImage", vkCreateImage(host->device, &image, NULL, &host->image));
    vkGetImageMemoryRequirements(host->device, host->image, &needs);
    host->image_memory = allocate(host, needs, 0);
    vkBindImageMemory(host->device, host->image, host->image_memory, 0);
    view.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO;
    view.image = host->image;
    view.viewType = VK_IMAGE_VIEW_TYPE_2D;
    view.format = image.format;
    view.subresourceRange.aspectMask = VK_IMAGE_ASPECT_COLOR_BIT;
    view.subresourceRange.levelCount = view.subresourceRange.layerCount = 1;
    vulkan("vkCreateImageView", vkCreateImageView(host->device, &view, NULL, &host->view));
    buffer.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
    buffer.size = BYTES;
    buffer.usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    vulkan("vkCreateBuffer", vkCreateBuffer(host->device, &buffer, NULL, &host->pixels));
    vkGetBufferMemoryRequirements(host->device, host->pixels, &needs);
    host->pixel_memory = allocate(
        host, needs, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
    vkBindBufferMemory(host->device, host->pixels, host->pixel_memory, 0);
}

static void create_commands(Host *host) {
    VkCommandPoolCreateInfo pool;
    VkCommandBufferAllocateInfo commands;
    ZERO(pool), ZERO(commands);
    pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
    vulkan("vkCreateCommandPool", vkCreateCommandPool(host->device, &pool, NULL, &host->pool));
    commands.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
    commands.commandPool = host->pool;
    commands.commandBufferCount = 1;
    vulkan("vkAllocateCommandBuffers", vkAllocateCommandBuffers(host->device, &commands, &host->commands));
}

/* Draws the model into the image, in a frame that copies its pixels to the buffer. */
static void draw(const Host *host, AshfallRenderer *renderer, AshfallModel *model) {
    AshfallInstance instance;
    AshfallCamera camera;
    AshfallImage color;
    AshfallDraw picture;
    VkCommandBufferBeginInfo begin;
    VkBufferImageCopy copy;
    VkSubmitInfo submit;
    ZERO(instance), ZERO(camera), ZERO(color), ZERO(picture), ZERO(begin), ZERO(copy), ZERO(submit);
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
    color.image = host->image;
    color.view = host->view;
    color.width = WIDTH;
    color.height = HEIGHT;
    color.after.layout = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;
    color.after.stage = VK_PIPELINE_STAGE_2_COPY_BIT;
    color.after.access = VK_ACCESS_2_TRANSFER_READ_BIT;
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

    begin.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
    vulkan("vkBeginCommandBuffer", vkBeginCommandBuffer(host->commands, &begin));
    ashfall("ashfall_cmd_draw", ashfall_cmd_draw(renderer, host->commands, 0, &picture, NULL));
    copy.imageSubresource.aspectMask = VK_IMAGE_ASPECT_COLOR_BIT;
    copy.imageSubresource.layerCount = copy.imageExtent.depth = 1;
    copy.imageExtent.width = WIDTH;
    copy.imageExtent.height = HEIGHT;
    vkCmdCopyImageToBuffer(
        host->commands, host->image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, host->pixels, 1, &copy);
    vulkan("vkEndCommandBuffer", vkEndCommandBuffer(host->commands));
    submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
    submit.commandBufferCount = 1;
    submit.pCommandBuffers = &host->commands;
    vulkan("vkQueueSubmit", vkQueueSubmit(host->queue, 1, &submit, VK_NULL_HANDLE));
    vulkan("vkQueueWaitIdle", vkQueueWaitIdle(host->queue));
}

static void write_pixels(const Host *host, const char *path) {
    void *pixels = NULL;
    FILE *file = fopen(path, "wb");
    vulkan("vkMapMemory", vkMapMemory(host->device, host->pixel_memory, 0, VK_WHOLE_SIZE, 0, &pixels));
    if (file == NULL || fwrite(pixels, 1, BYTES, file) != BYTES || fclose(file) != 0) fail(path, "not written");
    vkUnmapMemory(host->device, host->pixel_memory);
}

static void destroy(Host *host) {
    PFN_vkDestroyDebugUtilsMessengerEXT destroy_messenger = (PFN_vkDestroyDebugUtilsMessengerEXT)
        vkGetInstanceProcAddr(host->instance, "vkDestroyDebugUtilsMessengerEXT");
    vkDestroyImageView(host->device, host->view, NULL);
    vkDestroyImage(host->device, host->image, NULL);
    vkDestroyBuffer(host->device, host->pixels, NULL);
    vkFreeMemory(host->device, host->image_memory, NULL);
    vkFreeMemory(host->device, host->pixel_memory, NULL);
    vkDestroyCommandPool(host->device, host->pool, NULL);
    vkDestroyDevice(host->device, NULL);
    destroy_messenger(host->instance, host->messenger, NULL);
    vkDestroyInstance(host->instance, NULL);
}

int main(int count, char **arguments) {
    Host host;
    AshfallDevice *device;
    AshfallScene *scene = NULL;
    AshfallModel *model = NULL;
    AshfallRenderer *renderer = NULL;
    if (count != 3) fail("host", "the arguments are SCENE and PIXELS");
    ZERO(host);
    create_instance(&host);
    device = create_device(&host, VK_TRUE);
    create_image(&host);
    create_commands(&host);
    ashfall("ashfall_scene_read", ashfall_scene_read(arguments[1], &scene));
    ashfall("ashfall_model_upload", ashfall_model_upload(device, scene, ASHFALL_PRECISION_FULL, &model));
    ashfall("ashfall_scene_destroy", ashfall_scene_destroy(scene));
    ashfall("ashfall_renderer_create", ashfall_renderer_create(device, NULL, &renderer));
    draw(&host, renderer, model);
    write_pixels(&host, arguments[2]);
    ashfall("ashfall_renderer_destroy", ashfall_renderer_destroy(renderer));
    ashfall("ashfall_model_destroy", ashfall_model_destroy(model));
    ashfall("ashfall_device_destroy", ashfall_device_destroy(device));
    destroy(&host);
    return messages == 0 ? 0 : 2;
}
